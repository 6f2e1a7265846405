// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/operators.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

namespace efree {
namespace {

class Operators : public ::testing::TestWithParam<ApproximationOptions> {
 protected:
  testing::Body body_ = testing::body("plate_with_hole");
  Discretization<2> quadrature_ = approximate(body_.mesh, GetParam()).quadrature;
  Points<2> U_ = Points<2>::Random(2, quadrature_.shape.num_nodes());
};

TEST_P(Operators, InternalForceIsTheAdjointOfTheGradient) {
  const Gradients<2> stress = Gradients<2>::Random(5, quadrature_.size());
  const double work = (gradient(quadrature_, U_).cwiseProduct(stress).colwise().sum() * quadrature_.weights).value();
  EXPECT_NEAR(U_.cwiseProduct(internal_force(quadrature_, stress)).sum(), work,
              1e-12 * U_.norm() * internal_force(quadrature_, stress).norm());
}

TEST_P(Operators, StiffnessMatrixActsLikeGradientThenStressThenForce) {
  const auto A = Materials<2>({LinearElastic(1.0, 0.3)}, Plane::stress).tangents(quadrature_);
  const SymmetricMatrix K = stiffness_matrix(quadrature_, A);
  const Points<2> force = internal_force(quadrature_, Gradients<2>(A[0] * gradient(quadrature_, U_)));
  const Vector product = K.selfadjointView<Eigen::Lower>() * U_.reshaped();
  EXPECT_LT((product - force.reshaped()).cwiseAbs().maxCoeff(), 1e-12 * product.cwiseAbs().maxCoeff());
  for (Index c = 0; c < K.cols(); ++c)
    for (SymmetricMatrix::InnerIterator entry(K, c); entry; ++entry)
      ASSERT_GE(entry.row(), c) << "the lower triangle only";
}

TEST_P(Operators, RigidMotionsHaveNoStrain) {
  const auto approximation = approximate(body_.mesh, GetParam());
  Points<2> rotation(2, approximation.nodes.cols());
  rotation << -approximation.nodes.row(1), approximation.nodes.row(0);
  rotation.colwise() += Vec<2>(0.7, -0.4);
  EXPECT_LT(strain(approximation.quadrature, rotation).cwiseAbs().maxCoeff(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Discretizations, Operators,
                         ::testing::Values(ApproximationOptions{.spacing = 0.2},
                                           ApproximationOptions{.spacing = 0.2, .secondary = SecondaryKind::mls},
                                           ApproximationOptions{.order = 2, .spacing = 0.2},
                                           ApproximationOptions{.kind = BasisKind::p2}));

TEST(Kinematics, ForceByANormalIsTheTraction) {
  const Vec<3> n = Vec<3>(0.6, 0.8, -0.3).normalized();
  const Voigt<3> stress = Voigt<3>::Random();
  const Mat<3> tensor{
      {stress[0], stress[5], stress[4]}, {stress[5], stress[1], stress[3]}, {stress[4], stress[3], stress[2]}};
  EXPECT_LT((NodalGradient<3>{n}.force(tensor.reshaped()) - tensor * n).norm(), 1e-15);
  EXPECT_LT((traction<3>(stress, n) - tensor * n).norm(), 1e-15);
  EXPECT_LT((traction<2>({2.0, -1.0, 7.0, 0.5}, {0.6, 0.8}) - Vec<2>(1.6, -0.5)).norm(), 1e-15);
}

/// Each with the strains that there are: in the plane without that across it.
TEST(Materials, VolumetricAndDeviatoricPartsMakeTheWholeAndNeitherIsNegative) {
  const OrthotropicElastic wood({{0.6, 0.9, 11.0},
                                 {0.03, 0.02, 0.35},
                                 {0.7, 0.75, 0.04},
                                 Eigen::AngleAxisd(0.7, Vec<3>(1, 2, 3).normalized()).toRotationMatrix()});
  const Vec<2> x = Vec<2>::Zero();
  for (const Plane plane : {Plane::strain, Plane::stress, Plane::axisymmetric})
    for (const SharedMaterial& material : {SharedMaterial(LinearElastic(2.0, 0.4)), SharedMaterial(wood)}) {
      const Materials<2> materials({material}, plane);
      const Tangent<2> whole = materials.tangent(0, x), volumetric = materials.tangent(0, x, StiffnessPart::volumetric),
                       rest = materials.tangent(0, x, StiffnessPart::deviatoric);
      EXPECT_LT((volumetric + rest - whole).norm(), 1e-14 * whole.norm());
      const int there = plane == Plane::axisymmetric ? 5 : 4;
      const auto least = [&](const Tangent<2>& A) {
        return Eigen::SelfAdjointEigenSolver<Matrix>(Matrix(A.topLeftCorner(there, there))).eigenvalues().minCoeff();
      };
      EXPECT_GT(least(rest), -1e-13 * whole.norm());
      EXPECT_GT(least(volumetric), -1e-13 * whole.norm());
      EXPECT_LT(least(rest - 1e-3 * volumetric), -1e-5 * volumetric.norm()) << "no larger part would do";
      const Stiffness<2> stiffness = materials.stiffness(0, x);
      EXPECT_NEAR(stiffness.swelling.head<3>().sum(), 1.0, 1e-14);
      Gradient<2> swelling = Gradient<2>::Zero();
      for (const auto& [gradient, voigt] : {std::pair{0, 0}, {3, 1}, {4, 2}})
        swelling[gradient] = stiffness.swelling[voigt];
      swelling[1] = swelling[2] = 0.5 * stiffness.swelling[3];
      EXPECT_LT((rest * swelling).head(there).norm(), 1e-13 * whole.norm()) << "swelling has pressure alone";
    }
}

TEST(Materials, SplitOfIsotropicOnesIsThatOfLame) {
  const Lame lame = solid_lame({2.0, 0.4});
  const auto kappa = [](Plane plane) {
    return Materials<2>({LinearElastic(2.0, 0.4)}, plane).stiffness(0, Vec<2>::Zero()).kappa;
  };
  EXPECT_NEAR(kappa(Plane::strain), lame.lambda + lame.mu, 1e-14);
  EXPECT_NEAR(kappa(Plane::axisymmetric), lame.lambda + 2.0 * lame.mu / 3.0, 1e-14);
  EXPECT_NEAR(kappa(Plane::stress), 2.0 / (2.0 * (1.0 - 0.4)), 1e-14);
}

TEST(Materials, SplitKeepsTheShearOfNearlyIncompressibleOnes) {
  for (const double left : {1e-4, 1e-6, 1e-8}) {
    const Materials<3> materials({LinearElastic(3.0, 0.5 - left)}, Plane::strain);
    const double mu = solid_lame({3.0, 0.5 - left}).mu, rounding = 1e-15 / left;
    const Tangent<3> rest = materials.tangent(0, Vec<3>::Zero(), StiffnessPart::deviatoric);
    EXPECT_NEAR(rest(0, 0), 4.0 / 3.0 * mu, rounding) << left;
    EXPECT_NEAR(rest(0, 4), -2.0 / 3.0 * mu, rounding) << left;
    const Stiffness<3> stiffness = materials.stiffness(0, Vec<3>::Zero());
    Voigt<3> pressure = Voigt<3>::Zero();
    pressure.head<3>().setOnes();
    EXPECT_NEAR(pressure.dot(stiffness.S * pressure) * stiffness.kappa, 1.0, rounding) << left;
  }
}

TEST(Materials, PlanesPulledAlongXStretchAndThinAsTheyShould) {
  const double E = 3.0, nu = 0.25;
  const auto stiffness = [&](Plane plane) {
    return Materials<2>({LinearElastic(E, nu)}, plane).stiffness(0, Vec<2>::Zero());
  };
  const Voigt<2> thin(1.0 / E, -nu / E, 0.0, 0.0);
  EXPECT_LT((stiffness(Plane::stress).C * thin - Voigt<2>(1.0, 0.0, 0.0, 0.0)).norm(), 1e-15);
  EXPECT_NEAR(stiffness(Plane::stress).thinning.dot(thin), -nu / E, 1e-16);
  const Voigt<2> confined((1.0 - nu * nu) / E, -nu * (1.0 + nu) / E, 0.0, 0.0);
  EXPECT_LT((stiffness(Plane::strain).C * confined - Voigt<2>(1.0, 0.0, nu, 0.0)).norm(), 1e-15);
  EXPECT_EQ(stiffness(Plane::strain).thinning.norm(), 0.0);
}

}  // namespace
}  // namespace efree
