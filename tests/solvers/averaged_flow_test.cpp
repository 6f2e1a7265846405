// SPDX-License-Identifier: GPL-3.0-or-later
// Averaged dilatations where material flows must not lock, lose shape or soften: coarse versions of bench_averaging.
#include "efree/bench/yielding_bodies.hpp"

#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using namespace bench;

/// The softest mode of a ring that has yielded over more than half of its wall is an oval. Pressure patches with one
/// constant pressure each excite it: errors of -22 to +13 % of the displacement (eight nodes through the wall, at the
/// end).
TEST(AveragedDilatation, ThickRingUnderPressureIsNotMadeAnOvalByPatches) {
  const PressedRing body;
  const double spacing = 0.12;
  const FineMesh<2> mesh = body.mesh(0.5 * spacing);
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto result = analyse(mesh, body.settings({.spacing = spacing, .seed = seed}));
    ASSERT_EQ(result.stopped, "") << seed;
    EXPECT_TRUE(result.approximation.averaged);
    for (const auto& step : result.history) EXPECT_LT(std::abs(body.worst(step)), 0.02) << seed << ", " << step.time;
  }
}

TEST(AveragedDilatation, PlateOfMetalIsAsStiffAsAnElasticOneUntilItYields) {
  const BentPlate body;
  const double p = 100.0, exact = BentPlate::deflection(p);
  for (const double spacing : {0.25, 0.125}) {
    const FineMesh<2> mesh = body.mesh(spacing / 3.0);
    const auto result = analyse(mesh, body.settings({.spacing = spacing}, p));
    const auto pointwise = analyse(mesh, body.settings({.spacing = spacing, .dilatation = Dilatation::pointwise}, p));
    EXPECT_TRUE(result.approximation.averaged);
    EXPECT_EQ(result.history.back().dissipated, 0.0);
    const double w = result.history.back().probes.front()[1];
    EXPECT_NEAR(w, pointwise.history.back().probes.front()[1], 1e-6 * std::abs(exact));
    EXPECT_NEAR(w, exact, (spacing < 0.2 ? 0.01 : 0.03) * std::abs(exact));
  }
}

TEST(AveragedDilatation, CircularPlateBearsItsLimitLoadAndNoMore) {
  const BentPlate body;
  const double spacing = 0.25;
  const auto result = analyse(body.mesh(spacing / 3.0), body.settings({.spacing = spacing}, 400.0));
  EXPECT_NE(result.stopped, "");
  EXPECT_NEAR(result.history.back().time, BentPlate::limit, 0.02 * BentPlate::limit);
}

}  // namespace
}  // namespace efree
