// SPDX-License-Identifier: GPL-3.0-or-later
/// Cook's membrane (Cook 1974): clamped on the left, unit shear force on the right; deflection of the middle of the
/// right side.
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

double tip_deflection(const FineMesh<2>& mesh, const ApproximationOptions& options, const ElasticModel& model) {
  const auto approximation = approximate(mesh, options);
  const auto shear = [](const Vec<2>&, const Vec<2>&) -> Vec<2> { return {0.0, 1.0 / 16.0}; };
  const auto solution = ElasticSolver<2>(approximation, model, {clamp<2>("left")}).solve({{{"right", shear}}, {}});
  return probe<2>(approximation.space, recover_fields(approximation, solution), {48.0, 52.0}).displacement.y();
}

constexpr double cook_spacing = 3.4;

TEST(Cook, PlaneStressWithinOnePercentWith120Nodes) {
  const auto mesh = triangulate(shapes::cook(), {.size = cook_spacing / 8.0});
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_NEAR(tip_deflection(mesh, {.spacing = cook_spacing, .seed = seed},
                               {.material = LinearElastic(1.0, 1.0 / 3.0), .plane = Plane::stress}),
                23.967, 0.24)
        << "seed " << seed;
}

TEST(Cook, NearlyIncompressiblePlaneStrainWithinTwoPercentWith120Nodes) {
  const auto mesh = triangulate(shapes::cook(), {.size = cook_spacing / 8.0});
  const ElasticModel model{.material = LinearElastic(240.565, 0.4999), .plane = Plane::strain};
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_NEAR(
        tip_deflection(mesh, {.spacing = cook_spacing, .seed = seed, .dilatation = Dilatation::averaged}, model),
        0.07695, 0.00154)
        << "seed " << seed;
}

TEST(Cook, AMeanDilatationForEachClusterOfLinearFunctionsDoesAsWellWithLessThanHalfThePoints) {
  const auto mesh = triangulate(shapes::cook(), {.size = cook_spacing / 8.0});
  for (const double nu : {0.4999, 0.499999})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const ApproximationOptions options{.spacing = cook_spacing,
                                         .seed = seed,
                                         .secondary = SecondaryKind::linear,
                                         .dilatation = Dilatation::averaged};
      EXPECT_LE(approximate(mesh, options).ratio(), 1.7) << "seed " << seed;
      EXPECT_NEAR(tip_deflection(mesh, options, {.material = LinearElastic(240.565, nu), .plane = Plane::strain}),
                  0.07695, 0.00154)
          << "nu = " << nu << ", seed " << seed;
    }
}

TEST(Cook, LinearFiniteElementsLockWhereUnionsDoNot) {
  const ElasticModel model{.material = LinearElastic(240.565, 0.4999), .plane = Plane::strain};
  EXPECT_LT(tip_deflection(triangulate(shapes::cook(), {.size = 6.5}),
                           {.kind = BasisKind::p1, .dilatation = Dilatation::pointwise}, model),
            0.8 * 0.07695);
}

/// Strain energy of a bar 2 x 1 x 1 that is clamped at one end and sheared at the other.
double sheared_bar(const FineMesh<3>& mesh, const ApproximationOptions& options, double nu, Essential essential) {
  const auto approximation = approximate(mesh, options);
  const ScalarField<3> zero = [](const Vec<3>&) { return 0.0; };
  const ElasticSolver<3> solver(approximation, {.material = LinearElastic(1.0, nu), .essential = essential},
                                {{"left", {zero, zero, zero}, nullptr}});
  const auto down = [](const Vec<3>&, const Vec<3>&) -> Vec<3> { return {0.0, 0.0, -1.0}; };
  return solver.solve({.tractions = {{"right", down}}, .body_force = {}}).strain_energy;
}

TEST(NearlyIncompressibleBar, NitscheDoesNotLockHoweverNearPoissonsRatioIsToOneHalf) {
  const FineMesh<3> mesh(solids::box({2, 1, 1}, 0.14)), coarse(solids::box({2, 1, 1}, 0.3));
  const double elements =
      sheared_bar(coarse, {.kind = BasisKind::p2, .dilatation = Dilatation::pointwise}, 0.4999, Essential::strong);
  for (const double nu : {0.4999, 0.49999999})
    EXPECT_NEAR(
        sheared_bar(mesh, {.spacing = 0.35, .dilatation = Dilatation::averaged}, nu, Essential::nitsche) / elements,
        1.0, 0.04)
        << nu;
}

}  // namespace
}  // namespace efree
