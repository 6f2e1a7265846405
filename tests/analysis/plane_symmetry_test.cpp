// SPDX-License-Identifier: GPL-3.0-or-later
/// Symmetry, axes and constants of elastic tensors in the plane.
#include "efree/analysis/plane_symmetry.hpp"
#include "efree/core/error.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

PlaneElasticTensor orthotropic_in_plane(double C11, double C22, double C12, double C66) {
  PlaneElasticTensor C;
  C << C11, C12, 0, C12, C22, 0, 0, 0, C66;
  return C;
}

}  // namespace

TEST(PlaneSymmetry, OfIsotropyHasNoDistanceFromAnyClassInAnyAxes) {
  const PlaneElasticTensor C = orthotropic_in_plane(5.0, 5.0, 2.0, 1.5);
  EXPECT_LT((in_axes(C, 0.4) - C).norm(), 1e-14);
  const PlaneSymmetry symmetry = plane_symmetry_of(C);
  for (const double distance : symmetry.distances) EXPECT_NEAR(distance, 0.0, 1e-14);
  EXPECT_DOUBLE_EQ(symmetry.kappa, 3.5);
  EXPECT_DOUBLE_EQ(symmetry.mu, 1.5);
  EXPECT_EQ(symmetry.angle, 0.0);
  EXPECT_EQ(nearest_class(symmetry, 1e-12), PlaneSymmetryClass::isotropic);
}

TEST(PlaneSymmetry, FindsTheAxesOfOrthotropyThatIsTurned) {
  const PlaneElasticTensor C = orthotropic_in_plane(10.0, 3.0, 1.0, 2.0);
  const PlaneElasticTensor square = orthotropic_in_plane(6.0, 6.0, 1.0, 4.0);
  for (const double angle : {-0.7, -0.2, 0.01, 0.3, 0.78}) {
    const PlaneSymmetry symmetry = plane_symmetry_of(in_axes(C, -angle));
    EXPECT_NEAR(symmetry.angle, angle, 1e-9);
    EXPECT_LT((symmetry.there - C).norm(), 1e-8);
    EXPECT_LT(symmetry.distances[2], 1e-10);
    EXPECT_EQ(nearest_class(symmetry, 1e-6), PlaneSymmetryClass::orthotropic);
    EXPECT_EQ(nearest_class(plane_symmetry_of(in_axes(square, angle)), 1e-6), PlaneSymmetryClass::square);
  }
}

/// Least over all tensors of a class: the closest isotropic one has the same kappa and mu.
TEST(PlaneSymmetry, DistancesAreThoseFromTheClosestTensor) {
  PlaneElasticTensor C = orthotropic_in_plane(10.0, 3.0, 1.0, 2.0);
  C(0, 2) = C(2, 0) = 0.7;
  C(1, 2) = C(2, 1) = -0.1;
  const PlaneSymmetry symmetry = plane_symmetry_of(C);
  const auto isotropic = [](double kappa, double mu) {
    return orthotropic_in_plane(kappa + mu, kappa + mu, kappa - mu, mu);
  };
  const double distance = plane_norm_of(C - isotropic(symmetry.kappa, symmetry.mu));
  EXPECT_NEAR(symmetry.distances[0], distance / plane_norm_of(C), 1e-14);
  for (const double step : {1e-3, -1e-3}) {
    EXPECT_GT(plane_norm_of(C - isotropic(symmetry.kappa + step, symmetry.mu)), distance);
    EXPECT_GT(plane_norm_of(C - isotropic(symmetry.kappa, symmetry.mu + step)), distance);
  }
  PlaneElasticTensor closest = symmetry.there;
  closest(0, 2) = closest(2, 0) = closest(1, 2) = closest(2, 1) = 0.0;
  EXPECT_NEAR(symmetry.distances[2], plane_norm_of(symmetry.there - closest) / plane_norm_of(C), 1e-14);
  EXPECT_GT(symmetry.distances[2], 1e-3);
  EXPECT_EQ(nearest_class(symmetry, 1e-3), PlaneSymmetryClass::none);
  EXPECT_THROW(plane_symmetry_of(PlaneElasticTensor(PlaneElasticTensor::Zero())), InputError);
}

TEST(PlaneSymmetry, ConstantsTurnWithTheAxes) {
  const PlaneElasticTensor C = orthotropic_in_plane(10.0, 3.0, 1.0, 2.0), S = C.inverse();
  EXPECT_LT((compliance_in_axes(S, 0.6) - in_axes(C, 0.6).inverse()).norm(), 1e-14);
  const PlaneEngineeringConstants constants = plane_engineering_constants(S);
  EXPECT_NEAR(constants.E[0], 10.0 - 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(constants.nu, 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(constants.G, 2.0, 1e-12);
  const double half = 0.25 * std::numbers::pi;
  EXPECT_NEAR(plane_youngs_modulus(S, Vec<2>(std::cos(half), std::sin(half))),
              plane_engineering_constants(compliance_in_axes(S, half)).E[0], 1e-12);
}

}  // namespace efree
