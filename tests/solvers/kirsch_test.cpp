// SPDX-License-Identifier: GPL-3.0-or-later
/// Convergence on the plate with a hole.
#include "efree/tests/solvers/kirsch.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using testing::kirsch::Result;

/// Medians for spacing H with six fine cells to the spacing.
Result medians(double H, SecondaryKind secondary) {
  return testing::kirsch::median(testing::kirsch::mesh(H / 6.0), {.spacing = H, .secondary = secondary});
}

void expect_orders(SecondaryKind secondary, double least_l2) {
  const Result coarse = medians(0.8, secondary), fine = medians(0.1, secondary);
  const auto order = [&](double Result::*error) { return std::log2(coarse.*error / (fine.*error)) / 3.0; };
  EXPECT_GE(order(&Result::l2), least_l2);
  EXPECT_LE(order(&Result::l2), 2.7);
  EXPECT_GE(order(&Result::energy), 1.0);
  EXPECT_LE(order(&Result::energy), 1.8);
  EXPECT_GE(order(&Result::recovered), 1.2);
  EXPECT_LE(order(&Result::recovered), 2.0);
}

TEST(Kirsch, CellsConvergeInDisplacementAndEnergy) {
  expect_orders(SecondaryKind::cells, 1.8);
}
TEST(Kirsch, LumpedMlsConvergesInDisplacementAndEnergy) {
  expect_orders(SecondaryKind::mls, 1.7);
}

/// P1 errors on a logarithmic line through two meshes, at the given node count.
Result finite_elements_with(double nodes) {
  const auto coarse = testing::kirsch::solve(testing::kirsch::mesh(0.2), {.kind = BasisKind::p1});
  const auto fine = testing::kirsch::solve(testing::kirsch::mesh(0.1), {.kind = BasisKind::p1});
  const double share = std::log(nodes / coarse.nodes) / std::log(fine.nodes / coarse.nodes);
  const auto at = [&](double Result::*error) { return coarse.*error * std::pow(fine.*error / (coarse.*error), share); };
  return {nodes, at(&Result::l2), at(&Result::energy), at(&Result::recovered)};
}

TEST(Kirsch, BeatsLinearFiniteElementsWithAsManyNodes) {
  const Result cells = medians(0.1, SecondaryKind::cells);
  const Result p1 = finite_elements_with(cells.nodes);
  EXPECT_LE(cells.l2, p1.l2 / 4.0);
  EXPECT_LE(cells.energy, p1.energy / 2.0);
  EXPECT_LE(cells.recovered, p1.energy / 5.0);
}

}  // namespace
}  // namespace efree
