// SPDX-License-Identifier: GPL-3.0-or-later
/// Cook's membrane (Cook 1974): clamped on the left, unit shear force on the right; deflection of the middle of the
/// right side.
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

constexpr double spacing = 3.4;

TEST(Cook, PlaneStressWithinOnePercentWith120Nodes) {
  const auto mesh = triangulate(shapes::cook(), {.size = spacing / 8.0});
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_NEAR(tip_deflection(mesh, {.spacing = spacing, .seed = seed}, {.material = {1.0, 1.0 / 3.0}}), 23.967, 0.24)
        << "seed " << seed;
}

TEST(Cook, NearlyIncompressiblePlaneStrainWithinTwoPercentWith120Nodes) {
  const auto mesh = triangulate(shapes::cook(), {.size = spacing / 8.0});
  const ElasticModel model{.material = {240.565, 0.4999}, .plane = Plane::strain};
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_NEAR(tip_deflection(mesh, {.spacing = spacing, .seed = seed, .dilatation = true}, model), 0.07695, 0.00154)
        << "seed " << seed;
}

TEST(Cook, LinearFiniteElementsLockWhereUnionsDoNot) {
  const ElasticModel model{.material = {240.565, 0.4999}, .plane = Plane::strain};
  EXPECT_LT(tip_deflection(triangulate(shapes::cook(), {.size = 6.5}), {.kind = BasisKind::p1}, model), 0.8 * 0.07695);
}

}  // namespace
}  // namespace efree
