// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/plane_impact.hpp"

#include "efree/bench/bad_meshes.hpp"

#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using bench::PlaneImpact;

const OtmOptions options{.shock = {.linear = 0.5, .quadratic = 2.0}};

/// Share of the momentum that the bar has lost, over that by Rankine and Hugoniot.
template <int Dim> double momentum_lost(const FineMesh<Dim>& mesh, double speed) {
  auto otm = PlaneImpact::bar<Dim>(mesh, speed, options);
  const auto before = otm.balance();
  otm.run(PlaneImpact::until);
  const auto after = otm.balance();
  EXPECT_NEAR(after.total(), before.total(), 0.002 * before.total());
  EXPECT_LT(after.renewal, 0.05 * before.kinetic);
  return (1.0 - after.momentum[Dim - 1] / before.momentum[Dim - 1]) / PlaneImpact::momentum_lost(speed);
}

/// Of fluids the front runs at sound_speed + slope speed, and strength adds less than what it bears.
TEST(PlaneImpact, StrengthAddsLittleToTheStressOfAStrongShock) {
  for (const double speed : {300.0, 500.0, 800.0, 1200.0, 3000.0}) {
    const double fluid = PlaneImpact::density * (5350.0 + 1.34 * speed) * speed;
    EXPECT_GT(PlaneImpact::wall_stress(speed), fluid);
    EXPECT_LT(PlaneImpact::wall_stress(speed), fluid + 1.1 * PlaneImpact::yield);
  }
}

TEST(PlaneImpact, MetalOnCarelessTrianglesLosesTheMomentumOfItsHugoniot) {
  for (const double size : {0.02, 0.0196, 0.01})
    for (const double speed : {300.0, 500.0, 800.0, 1200.0})
      EXPECT_NEAR(momentum_lost(PlaneImpact::mesh<2>(size), speed), 1.0, 0.015) << size << ", " << speed;
}

TEST(PlaneImpact, MetalOnTrianglesThatAreJitteredLosesTheMomentumOfItsHugoniot) {
  const FineMesh<2> mesh = PlaneImpact::mesh<2>(0.02);
  for (const unsigned seed : {1u, 2u, 3u})
    for (const double speed : {300.0, 500.0, 800.0, 1200.0})
      EXPECT_NEAR(momentum_lost(bench::jittered(mesh, 0.02, seed), speed), 1.0, 0.03) << seed << ", " << speed;
}

TEST(PlaneImpact, MetalOnCarelessTetrahedraLosesTheMomentumOfItsHugoniot) {
  const FineMesh<3> mesh = PlaneImpact::mesh<3>(0.04);
  for (const double speed : {300.0, 500.0, 800.0, 1200.0}) EXPECT_NEAR(momentum_lost(mesh, speed), 1.0, 0.02) << speed;
}

}  // namespace
}  // namespace efree
