// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: modes that few quadrature points do not see.
#include "efree/bench/tangent_modes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace efree {
namespace {

using bench::Coercivity, bench::StrainedBlock;

TEST(StabilityPoints, DefaultPointsSeeMostOfTheLeastStiffnessAtRestAtLargeStrainsAndAfterYield) {
  constexpr double spacing = 0.16;
  const FineMesh<2> mesh = StrainedBlock::mesh(spacing / 6.0);
  for (const auto& block : StrainedBlock::all()) {
    const bool yields = std::string(block.name) == "yielding";
    std::vector<double> seen;
    for (std::uint64_t seed = 1; seed <= (yields ? 5 : 2); ++seed) {
      const Coercivity found(block, mesh, {.spacing = spacing, .seed = seed});
      EXPECT_EQ(found.zero(), 0) << block.name;
      EXPECT_EQ(found.negative(), 0) << block.name;
      EXPECT_GT(found.seen(), yields ? 0.8 : 0.6) << block.name;
      seen.push_back(found.seen());
    }
    std::ranges::sort(seen);
    EXPECT_GT(seen[seen.size() / 2], 0.6) << block.name << ", median";
  }
}

TEST(StabilityPoints, APointForTwoNodesLeavesModesThatAreNotSeenAndLetsASqueezedBodyGo) {
  constexpr double spacing = 0.125;
  const FineMesh<2> mesh = StrainedBlock::mesh(spacing / 6.0);
  const auto all = StrainedBlock::all();
  EXPECT_GT(Coercivity(all[0], mesh, {.spacing = spacing, .ratio = 0.5}).zero(), 0);
  EXPECT_GT(Coercivity(all[2], mesh, {.spacing = spacing, .ratio = 0.5}).negative(), 0);
}

}  // namespace
}  // namespace efree
