// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/plane_impact.hpp"

#include "efree/bench/bad_meshes.hpp"
#include "efree/bench/elastic_block.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using bench::PlaneImpact;

template <class T> class OnePlate : public ::testing::Test {};
using Dimensions = ::testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(OnePlate, Dimensions);

/// One cell thick.
template <int Dim> FineMesh<Dim> thin_plate() {
  if constexpr (Dim == 2)
    return triangulate(shapes::rectangle(0.0, 0.0, 12.0, 1.0), {.size = 1.4});
  else
    return FineMesh<3>(solids::box({5.0, 5.0, 1.0}, 1.7));
}

const DynamicsOptions options{.shock = {.linear = 0.5, .quadratic = 2.0}};

/// Share of the momentum that the bar has lost, over that by Rankine and Hugoniot.
template <int Dim> double momentum_lost(const FineMesh<Dim>& mesh, double speed) {
  auto dynamics = PlaneImpact::bar<Dim>(mesh, speed, {}, options);
  const auto before = dynamics.balance();
  dynamics.run(PlaneImpact::until);
  const auto after = dynamics.balance();
  EXPECT_NEAR(after.total(), before.total(), 0.002 * before.total());
  EXPECT_LT(after["reconnection"], 0.05 * before["kinetic"]);
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

/// All the energy of such a plate is in its fastest vibration, of whose period a step is a sixth or so. It stands on
/// the wall when it is thrown at it, is stopped by its nodes there, or flies a while; at next to no speed and at a
/// fifth of that of sound.
TYPED_TEST(OnePlate, KeepsItsEnergyFromTheFirstStepOnWhateverItsViscosity) {
  constexpr int Dim = TypeParam::value;
  enum class By { wall, far_wall, nodes };
  const Vec<Dim> up = Vec<Dim>::Unit(Dim - 1);
  for (const double speed : {1e-4, 0.2})
    for (const double linear : {0.06, 0.5, 1.0, 2.0})
      for (const By by : {By::wall, By::far_wall, By::nodes}) {
        DeformableBody<Dim> body = deformable_body(thin_plate<Dim>(), bench::soft(), 1.0);
        body.velocity = (-speed * up).replicate(1, body.nodes.cols());
        Dynamics<Dim> dynamics({body}, otm<Dim>(), {.shock = {.linear = linear, .quadratic = 2.0}});
        if (by != By::nodes) dynamics.add_wall({.normal = up, .level = by == By::wall ? 0.0 : -2.3 * speed});
        const double start = dynamics.balance().total();
        if (by == By::nodes)
          for (Index a = 0; a < dynamics.num_nodes(); ++a)
            if (body.nodes(Dim - 1, a) < 1e-9) dynamics.prescribe(a, Dim - 1, 0.0);
        double left = by == By::nodes ? dynamics.balance().total() : start, worst = 0.0;
        for (int k = 0; k < 60; ++k) {
          dynamics.step();
          worst = std::max(worst, std::abs(dynamics.balance().total() - left) / start);
        }
        EXPECT_LT(worst, speed < 0.1 ? 0.01 : 0.03) << speed << " " << linear << " " << static_cast<int>(by);
      }
}

}  // namespace
}  // namespace efree
