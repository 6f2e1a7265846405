// SPDX-License-Identifier: GPL-3.0-or-later
// Stability: pressures of nearly incompressible bodies.
#include "efree/bench/pressures.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using namespace bench;

/// Of the answer at the defaults, which corrections towards elements end at, and of the cloud alone.
TEST(StabilityPressure, MeanStressOfAThickTubeIsConstant) {
  const FineMesh<2> mesh = triangulate(Tube::domain(0.03), {.size = 0.03});
  for (const double nu : {0.499, 0.4999}) {
    const Tube tube{nu};
    Settings<2> settings = tube.settings();
    settings.approximation.spacing = 0.12;
    EXPECT_LT(Swing(analyse(mesh, settings), tube.mean_stress()).mean, 0.01) << nu;
    settings.estimated = settings.corrected = false;
    EXPECT_LT(Swing(analyse(mesh, settings), tube.mean_stress()).mean, 0.03) << nu;
  }
}

/// Unions that hold less than a node are merged with another: by themselves these have 0.40, 0.32 and 0.50 here.
TEST(StabilityPressure, InfSupValueOfUnionsStaysAboveOneHalfOnThreeClouds) {
  constexpr double H = 0.05;
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 6.0});
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
    EXPECT_GT(inf_sup(approximate(mesh, {.spacing = H, .seed = seed, .dilatation = Dilatation::averaged})), 0.5)
        << seed;
}

/// Over H, H/2, H/4.
TEST(StabilityPressure, InfSupValueOfLevelledClustersDoesNotDecay) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    double before = 0.0;
    for (const double H : {0.2, 0.1, 0.05}) {
      const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 6.0});
      const double value = inf_sup(approximate(
          mesh, {.spacing = H, .seed = seed, .secondary = SecondaryKind::linear, .dilatation = Dilatation::averaged}));
      EXPECT_GT(value, before) << "H " << H << ", cloud " << seed;
      before = 0.9 * value;
    }
  }
}

}  // namespace
}  // namespace efree
