// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: volumetric locking.
#include "efree/bench/cook.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using bench::Cook;

/// The cloud by itself, about 120 nodes; references of bench_stability truth.
constexpr double cook_spacing = 3.2;

double error_of_tip(const FineMesh<2>& mesh, double nu, bool finite, std::uint64_t seed) {
  const auto truth = std::ranges::find(Cook::truths, nu, &Cook::Truth::nu);
  return Cook::tip(mesh, Cook{nu, finite}.cloud(cook_spacing, seed)) / (finite ? truth->finite : truth->small) - 1.0;
}

TEST(StabilityLocking, TipOfCooksMembraneIsWithinTwoPercentWith120NodesAtSmallAndFiniteStrains) {
  const FineMesh<2> mesh = Cook::mesh(cook_spacing / 6.0);
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
    EXPECT_LT(std::abs(error_of_tip(mesh, 0.4999, false, seed)), 0.02) << seed;
  EXPECT_LT(std::abs(error_of_tip(mesh, 0.4999, true, 1)), 0.02);
  EXPECT_LT(std::abs(error_of_tip(mesh, 0.3, true, 1)), 0.02);
}

/// By the clouds alone; from nu = 0.49 on nothing grows any more.
TEST(StabilityLocking, ErrorIsTheSameHoweverNearPoissonsRatioIsToOneHalf) {
  const FineMesh<2> mesh = Cook::mesh(cook_spacing / 6.0);
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const double at_49 = error_of_tip(mesh, 0.49, false, seed), at_half = error_of_tip(mesh, 0.499999, false, seed);
    EXPECT_LT(std::abs(at_half), 0.01) << seed;
    EXPECT_NEAR(at_half, at_49, 0.001) << seed;
  }
}

/// The answer at the defaults, which is corrected towards elements.
TEST(StabilityLocking, ErrorNextToOneHalfIsAtMostTwiceThatOfACompressibleMembrane) {
  const FineMesh<2> mesh = Cook::mesh(cook_spacing / 6.0);
  for (const bool finite : {false, true}) {
    const auto error = [&](double nu) {
      Settings<2> settings = Cook{nu, finite}.settings();
      settings.common.approximation.spacing = cook_spacing;
      const auto truth = std::ranges::find(Cook::truths, nu, &Cook::Truth::nu);
      return std::abs(Cook::tip(mesh, settings) / (finite ? truth->finite : truth->small) - 1.0);
    };
    EXPECT_LT(error(0.499999), 2.0 * error(0.3)) << finite;
  }
}

}  // namespace
}  // namespace efree
