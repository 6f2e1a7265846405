// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/folding_scenes.hpp"
#include "efree/materials/equation_of_state.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

void expect_folded(const bench::Folding& folding) {
  EXPECT_LT(folding.penetration, 0.2);
  EXPECT_LT(std::abs(folding.energy_error), 0.01);
  EXPECT_GT(folding.contact, 1e-3);
}

TEST(SelfContact, ArmsOfAUMeetInTheMiddleAndBounceBack) {
  auto dynamics = bench::closing_u(0.1);
  const Points<2> start = dynamics.nodes();
  std::vector<Index> right;
  for (Index a = 0; a < start.cols(); ++a)
    if (start(1, a) > 0.5 && start(0, a) > 0.0) right.push_back(a);
  double furthest = 1.0;
  for (double time = 0.1; time < 4.05; time += 0.1) {
    expect_folded(bench::Folding{.penetration = bench::self_penetration(dynamics), .contact = 1.0});
    dynamics.run(time);
    furthest = std::min(furthest, dynamics.nodes()(0, right).minCoeff());
  }
  EXPECT_NEAR(furthest, 0.0, 0.01);
  EXPECT_GT(dynamics.nodes()(0, right).mean(), start(0, right).mean());
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TEST(SelfContact, InnerSidesOfAFlattenedTubeLieOnEachOther) {
  auto dynamics = bench::flattened_tube(0.05);
  expect_folded(bench::fold(dynamics, 5.0));
}

TEST(SelfContact, ASheetThatIsCrumpledDoesNotPassThroughItself) {
  auto dynamics = bench::crumpled_sheet(0.06, 0.3);
  expect_folded(bench::fold(dynamics, 7.0));
}

TEST(SelfContact, CanBeSwitchedOff) {
  const auto body =
      deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.3}), bench::folding_rubber(), 1.0);
  const Dynamics<2> with({body}, otm<2>()), without({body}, otm<2>(), {.contact = {.self = false}});
  EXPECT_TRUE(with.world().has_self_contact(0));
  EXPECT_FALSE(without.world().has_self_contact(0));
}

/// A slab 1 wide with a gap from its top down to its middle.
DeformableBody<2> slab_with_gap(double width, double spacing) {
  const double a = 0.5 - 0.5 * width, b = 0.5 + 0.5 * width;
  const PlanarDomain domain{
      .boundary = {{"", {{0, 0}, {1, 0}, {1, 1}, {b, 1}, {b, 0.5}, {a, 0.5}, {a, 1}, {0, 1}, {0, 0}}}}};
  return deformable_body(triangulate(domain, {.size = spacing}), bench::folding_rubber(), 1.0);
}

TEST(SelfContact, ShapeFunctionsDoNotReachAcrossANarrowGap) {
  const Dynamics<2> dynamics({slab_with_gap(0.02, 0.1)}, otm<2>());
  int near = 0;
  for (const auto& chunk : dynamics.world().chunks)
    for (Index p = 0; p < chunk.size(); ++p) {
      const Vec<2> at = chunk.matter.x.col(p);
      if (at[1] < 0.7) continue;
      near += std::abs(at[0] - 0.5) < 0.1 ? 1 : 0;
      for (const auto& [node, entry] : chunk.table.row(p))
        EXPECT_GT((dynamics.nodes()(0, node) - 0.5) * (at[0] - 0.5), 0.0)
            << "point at " << at.transpose() << ", node at " << dynamics.nodes().col(node).transpose();
    }
  EXPECT_GT(near, 5);
}

}  // namespace
}  // namespace efree
