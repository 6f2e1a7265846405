// SPDX-License-Identifier: GPL-3.0-or-later
/// Convergence on the plate with a hole.
#include "efree/tests/solvers/kirsch.hpp"

#include <gtest/gtest.h>
#include <map>

namespace efree {
namespace {

using testing::kirsch::Result;

/// Medians over the spacings 0.8, 0.4, 0.2, 0.1 with six fine cells to the spacing.
const std::array<Result, 4>& medians(SecondaryKind secondary) {
  static std::map<SecondaryKind, std::array<Result, 4>> known;
  const auto [entry, is_new] = known.try_emplace(secondary);
  for (int k = 0; is_new && k < 4; ++k) {
    const double H = 0.8 / (1 << k);
    entry->second[k] = testing::kirsch::median(testing::kirsch::mesh(H / 6.0), {.spacing = H, .secondary = secondary});
  }
  return entry->second;
}

/// Order between the first and the last spacing.
double order(const std::array<Result, 4>& results, double Result::*error) {
  return std::log2(results.front().*error / (results.back().*error)) / 3.0;
}

TEST(Kirsch, CellsConvergeInDisplacementAndEnergy) {
  const auto& results = medians(SecondaryKind::cells);
  EXPECT_GE(order(results, &Result::l2), 1.8);
  EXPECT_LE(order(results, &Result::l2), 2.7);
  EXPECT_GE(order(results, &Result::energy), 1.0);
  EXPECT_LE(order(results, &Result::energy), 1.8);
}

TEST(Kirsch, LumpedMlsConvergesInDisplacementAndEnergy) {
  const auto& results = medians(SecondaryKind::mls);
  EXPECT_GE(order(results, &Result::l2), 1.7);
  EXPECT_LE(order(results, &Result::l2), 2.7);
  EXPECT_GE(order(results, &Result::energy), 1.0);
  EXPECT_LE(order(results, &Result::energy), 1.8);
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
  const Result& cells = medians(SecondaryKind::cells).back();
  const Result p1 = finite_elements_with(cells.nodes);
  EXPECT_LE(cells.l2, p1.l2 / 4.0);
  EXPECT_LE(cells.energy, p1.energy / 2.0);
  EXPECT_LE(cells.recovered, p1.energy / 3.0);
}

}  // namespace
}  // namespace efree
