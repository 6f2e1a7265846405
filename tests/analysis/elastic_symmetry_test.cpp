// SPDX-License-Identifier: GPL-3.0-or-later
/// Symmetry, axes and constants of elastic tensors.
#include "efree/analysis/elastic_symmetry.hpp"
#include "efree/core/error.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

namespace efree {
namespace {

ElasticTensor cubic(double C11, double C12, double C44) {
  ElasticTensor C = ElasticTensor::Zero();
  C.topLeftCorner<3, 3>().setConstant(C12);
  C.diagonal().head<3>().setConstant(C11);
  C.diagonal().tail<3>().setConstant(C44);
  return C;
}
ElasticTensor orthotropic() {
  ElasticTensor C = ElasticTensor::Zero();
  C.topLeftCorner<3, 3>() << 20.0, 4.0, 3.0, 4.0, 12.0, 2.0, 3.0, 2.0, 8.0;
  C.diagonal().tail<3>() << 2.0, 3.0, 5.0;
  return C;
}
Mat<3> turned(double angle, const Vec<3>& about) {
  return Eigen::AngleAxisd(angle, about.normalized()).toRotationMatrix();
}

}  // namespace

TEST(ElasticSymmetry, OfIsotropyHasNoDistanceFromAnyClass) {
  const ElasticTensor C = cubic(5.0, 2.0, 1.5);
  const ElasticSymmetry symmetry = symmetry_of(C);
  for (const double distance : symmetry.distances) EXPECT_NEAR(distance, 0.0, 1e-12);
  EXPECT_NEAR(symmetry.kappa, 3.0, 1e-12);
  EXPECT_NEAR(symmetry.mu, 1.5, 1e-12);
  EXPECT_NEAR(symmetry.zener, 1.0, 1e-12);
  EXPECT_NEAR(universal_anisotropy(C, C.inverse()), 0.0, 1e-12);
  EXPECT_EQ(nearest_class(symmetry, 1e-6), SymmetryClass::isotropic);
  EXPECT_TRUE(symmetry.axes.isIdentity());
}

TEST(ElasticSymmetry, OfATurnedCubicCrystalIsFoundThoughItsTensorsOfSecondOrderAreIsotropic) {
  const ElasticTensor C = cubic(168.4, 121.4, 75.4);  // copper
  const ElasticTensor there = in_axes(C, turned(0.5, {1.0, 2.0, -1.0}));
  const ElasticSymmetry symmetry = symmetry_of(there);
  EXPECT_LT(symmetry.distances[1], 1e-6);
  EXPECT_GT(symmetry.distances[0], 0.05);
  EXPECT_NEAR(symmetry.zener, 2.0 * 75.4 / (168.4 - 121.4), 1e-5);
  EXPECT_EQ(nearest_class(symmetry, 1e-4), SymmetryClass::cubic);
  EXPECT_NEAR(universal_anisotropy(there, there.inverse()), universal_anisotropy(C, C.inverse()), 1e-9);
}

TEST(ElasticSymmetry, OfATurnedOrthotropicBodyHasItsAxesAndConstants) {
  const ElasticTensor C = orthotropic();
  const Mat<3> R = turned(0.35, {0.3, -1.0, 0.6});
  const ElasticSymmetry symmetry = symmetry_of(in_axes(C, R.transpose()));
  EXPECT_LT(symmetry.distances[3], 1e-6);
  EXPECT_GT(symmetry.distances[2], 0.01);
  EXPECT_LT((symmetry.axes - R).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LT((symmetry.there - C).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_EQ(nearest_class(symmetry, 1e-4), SymmetryClass::orthotropic);
}

TEST(ElasticSymmetry, OfLayersIsTransverselyIsotropicAboutTheirNormal) {
  ElasticTensor C = ElasticTensor::Zero();
  C.topLeftCorner<3, 3>() << 3.0, 1.0, 1.0, 1.0, 10.0, 4.0, 1.0, 4.0, 10.0;
  C.diagonal().tail<3>() << 3.0, 1.2, 1.2;
  const ElasticSymmetry symmetry = symmetry_of(C);
  EXPECT_NEAR(symmetry.distances[2], 0.0, 1e-12);
  EXPECT_EQ(symmetry.special_axis, 0);
  EXPECT_EQ(nearest_class(symmetry, 1e-6), SymmetryClass::transversely_isotropic);
}

TEST(ElasticSymmetry, KeepsNormsWhenAxesTurn) {
  const ElasticTensor C = orthotropic(), there = in_axes(C, turned(1.1, {1.0, 1.0, 0.2}));
  EXPECT_NEAR(norm_of(there), norm_of(C), 1e-12 * norm_of(C));
  EXPECT_LT((in_axes(there, turned(-1.1, {1.0, 1.0, 0.2})) - C).cwiseAbs().maxCoeff(), 1e-12 * norm_of(C));
}

TEST(ElasticSymmetry, ConstantsAreThoseOfTheCompliance) {
  const ElasticTensor S = orthotropic().inverse();
  const EngineeringConstants constants = engineering_constants(S);
  for (int d = 0; d < 3; ++d) EXPECT_NEAR(constants.E[d], youngs_modulus(S, Vec<3>::Unit(d)), 1e-12);
  EXPECT_NEAR(constants.G[0], 2.0, 1e-12);
  EXPECT_NEAR(constants.nu[2], -S(0, 1) * constants.E[0], 1e-12);
  // Along the diagonal of a cubic crystal: 1/E = S11 - 2/3 (S11 - S12 - S44/2).
  const ElasticTensor T = cubic(168.4, 121.4, 75.4).inverse();
  EXPECT_NEAR(1.0 / youngs_modulus(T, Vec<3>::Ones().normalized()),
              T(0, 0) - 2.0 / 3.0 * (T(0, 0) - T(0, 1) - 0.5 * T(3, 3)), 1e-12);
}

TEST(ElasticSymmetry, NeedsAStiffness) {
  EXPECT_THROW(symmetry_of(ElasticTensor::Zero()), InputError);
}

}  // namespace efree
