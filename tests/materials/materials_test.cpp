// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/tests/materials/derivatives.hpp"

#include <gmock/gmock.h>
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace efree {
namespace {

const OrthotropicModuli spruce{{0.6, 0.9, 11.0}, {0.03, 0.02, 0.35}, {0.7, 0.75, 0.04}};

Mat<3> turned() {
  return (Eigen::AngleAxisd(0.7, Vec<3>::UnitZ()) * Eigen::AngleAxisd(-0.4, Vec<3>::UnitX())).toRotationMatrix();
}
OrthotropicModuli turned_spruce() {
  OrthotropicModuli moduli = spruce;
  moduli.axes = turned();
  return moduli;
}
double young(const Vec<3>& X) {
  return 2.0 + std::sin(3.0 * X[0]) * X[1];
}

/// F = I + H for one point at the origin.
Deformation stretched(const Material& material, const Mat<3>& H) {
  return testing::deformed(material, Mat<3>::Identity() + H);
}

TEST(Materials, StressAndTangentAreDerivativesOfTheEnergy) {
  const LinearElastic isotropic(2.0, 0.3), graded(young, 0.3);
  const OrthotropicElastic wood(turned_spruce()), graded_wood(turned_spruce(), young);
  const PlaneStress sheet{SharedMaterial(isotropic)}, veneer{SharedMaterial(wood)};
  for (const Material* material : {static_cast<const Material*>(&isotropic), static_cast<const Material*>(&graded),
                                   static_cast<const Material*>(&wood), static_cast<const Material*>(&graded_wood),
                                   static_cast<const Material*>(&sheet), static_cast<const Material*>(&veneer)}) {
    auto at = testing::random_deformation(*material, 5, 0.2);
    const bool planar = dynamic_cast<const PlaneStress*>(material) != nullptr;
    if (planar)
      for (const int k : {2, 5, 6, 7, 8}) at.F.row(k).setConstant(k == 8 ? 1.0 : 0.0);
    const auto [stress, tangent] = planar ? testing::derivative_errors(*material, at, 1e-4, {0, 1, 3, 4})
                                          : testing::derivative_errors(*material, at, 1e-4);
    EXPECT_LT(stress, 1e-10);
    EXPECT_LT(tangent, 1e-10);
  }
}

TEST(Materials, PlaneStressIsTheClosedFormAndTellsTheThickness) {
  const IsotropicModuli steel{210.0, 0.29};
  const PlaneStress sheet{SharedMaterial(LinearElastic(steel))};
  Mat<3> H = Mat<3>::Zero();
  H << 1e-3, 4e-4, 0.0, 2e-4, -3e-4, 0.0, 0.0, 0.0, 0.0;
  auto response = respond(sheet, stretched(sheet, H), true);
  const Lame lame = plane_lame(steel, Plane::stress);
  const Mat<3> eps = 0.5 * (H + H.transpose());
  Mat<3> expected = 2.0 * lame.mu * eps;
  expected(0, 0) += lame.lambda * eps.trace();
  expected(1, 1) += lame.lambda * eps.trace();
  EXPECT_LT((response.stress(0) - expected).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_NEAR(response.history(0, 0), -steel.nu / (1.0 - steel.nu) * eps.trace(), 1e-16);
  EXPECT_NEAR(response.energy[0], 0.5 * expected.cwiseProduct(eps).sum(), 1e-16);
  const Vec<9> stress = response.tangent_at(0) * H.reshaped();
  EXPECT_LT((stress - expected.reshaped()).cwiseAbs().maxCoeff(), 1e-13);
}

TEST(Materials, OrthotropicWithEqualModuliIsIsotropicHoweverItIsTurned) {
  const double E = 3.0, nu = 0.27, G = E / (2.0 * (1.0 + nu));
  OrthotropicModuli same{Vec<3>::Constant(E), Vec<3>::Constant(nu), Vec<3>::Constant(G)};
  same.axes = turned();
  const OrthotropicElastic turned_material(same);
  const LinearElastic isotropic(E, nu);
  const auto at = testing::random_deformation(isotropic, 4, 0.1);
  const auto a = respond(turned_material, at, true), b = respond(isotropic, at, true);
  EXPECT_LT((a.P - b.P).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((a.A - b.A).cwiseAbs().maxCoeff(), 1e-13);
}

TEST(Materials, OrthotropicPulledAlongAnAxisStretchesAndThinsByItsModuli) {
  const OrthotropicElastic wood(turned_spruce());
  auto response = respond(wood, stretched(wood, Mat<3>::Zero()), true);
  // Symmetric strains only: the tangent does not see rotations.
  Eigen::Matrix<double, 9, 6> symmetric = Eigen::Matrix<double, 9, 6>::Zero();
  for (int c = 0; const auto& [i, j] : {std::pair{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}) {
    symmetric(i + 3 * j, c) += 0.5;
    symmetric(j + 3 * i, c++) += 0.5;
  }
  const Eigen::Matrix<double, 6, 6> C = symmetric.transpose() * response.tangent_at(0) * symmetric;
  const Mat<3> axes = turned();
  const auto strain_by = [&](const Mat<3>& stress) {
    const Vec<6> eps = C.partialPivLu().solve(Vec<6>(symmetric.transpose() * stress.reshaped()));
    const Vec<9> flat = symmetric * eps;
    return Mat<3>(axes.transpose() * Eigen::Map<const Mat<3>>(flat.data()) * axes);
  };
  const auto& [E, nu, G, unused] = spruce;
  const Mat<3> pulled = strain_by(axes.col(0) * axes.col(0).transpose());
  EXPECT_NEAR(pulled(0, 0), 1.0 / E[0], 1e-12);
  EXPECT_NEAR(pulled(1, 1), -nu[2] / E[0], 1e-12) << "nu_xy";
  EXPECT_NEAR(pulled(2, 2), -nu[1] / E[0], 1e-12) << "nu_xz";
  const Mat<3> sheared = strain_by(axes.col(1) * axes.col(2).transpose() + axes.col(2) * axes.col(1).transpose());
  EXPECT_NEAR(2.0 * sheared(1, 2), 1.0 / G[0], 1e-12) << "G_yz";
  EXPECT_NEAR(sheared(0, 1), 0.0, 1e-12);
}

TEST(Materials, FieldsAreThoseOfThePlace) {
  const LinearElastic graded(young, 0.3);
  EXPECT_FALSE(graded.homogeneous());
  EXPECT_TRUE(LinearElastic(1.0, 0.3).homogeneous());
  const auto at = testing::random_deformation(graded, 6, 0.1);
  const auto found = respond(graded, at, false);
  for (Index p = 0; p < at.size(); ++p) {
    const LinearElastic here(young(at.X.col(p)), 0.3);
    Deformation one{at.X.col(p), at.F.col(p), Matrix(0, 1)};
    EXPECT_LT((respond(here, one, false).P - found.P.col(p)).cwiseAbs().maxCoeff(), 1e-14);
  }
}

TEST(Materials, IncompressibilityIsBulkOverShearModulus) {
  for (const double nu : {-0.5, 0.0, 0.3, 0.49, 0.4999}) {
    const LinearElastic material(7.0, nu);
    const auto response = respond(material, Deformation::none(Points<3>::Zero(3, 1)), true);
    EXPECT_NEAR(incompressibility(response.tangent_at(0)), 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu)),
                1e-9 / (0.5 - nu));
  }
}

TEST(Materials, RefuseParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses([] { LinearElastic(-1.0, 0.3); }, "E = -1");
  refuses([] { LinearElastic(1.0, 0.5); }, "nu = 0.5");
  refuses(
      [] {
        const LinearElastic graded([](const Vec<3>& X) { return X[0]; }, 0.3);
        respond(graded, Deformation::none(Points<3>::Constant(3, 1, -2.0)), false);
      },
      "at (-2, -2, -2)");
  OrthotropicModuli bad = spruce;
  bad.nu[2] = 3.0;
  refuses([&] { OrthotropicElastic{bad}; }, "indefinite");
  bad = spruce;
  bad.axes(0, 0) = 2.0;
  refuses([&] { OrthotropicElastic{bad}; }, "orthonormal");
  bad = spruce;
  bad.G[1] = 0.0;
  refuses([&] { OrthotropicElastic{bad}; }, "shear moduli");
  refuses([] { *SharedMaterial(); }, "no material");
  const PlaneStress sheet{SharedMaterial(LinearElastic(1.0, 0.3))};
  refuses([&] { respond(sheet, Deformation::none(Points<3>::Zero(3, 2)), false); }, "expected 3 x 2");
}

}  // namespace
}  // namespace efree
