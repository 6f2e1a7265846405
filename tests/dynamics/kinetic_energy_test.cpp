// SPDX-License-Identifier: GPL-3.0-or-later
/// Kinetic energies: of bodies at rest, in free fall, and with prescribed velocities.
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

/// A rectangle of density 1 with its lower side at that height.
DeformableBody<2> rectangle(double width, double height, double level, double E = 10.0, bool has_functions = false) {
  const auto mesh = triangulate(shapes::rectangle(0.0, level, width, level + height), {.size = 0.25});
  const SharedMaterial material = NeoHookean({.E = E, .nu = 0.0});
  return has_functions ? deformable_body(approximate(mesh, {.kind = BasisKind::p1}), material, 1.0)
                       : deformable_body(mesh, material, 1.0);
}

/// Largest kinetic over stored energy in 20 steps, once damping has brought the bodies to rest under a gravity of 0.1.
double kinetic_over_stored_at_rest(Dynamics<2>& dynamics, double until = 200.0) {
  dynamics.set_gravity({0.0, -0.1});
  dynamics.run(until);
  double largest = 0.0;
  for (int k = 0; k < 20; ++k) {
    dynamics.step();
    const auto balance = dynamics.balance();
    EXPECT_GT(balance["stored"], 1e-6);
    largest = std::max(largest, std::abs(balance["kinetic"]) / balance["stored"]);
  }
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3);
  return largest;
}

TEST(KineticEnergy, OfABlockAtRestOnAWallIsZero) {
  Dynamics<2> dynamics({rectangle(1.0, 1.0, 0.0)}, otm<2>(), {.damping = 1.0});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-10);
}

TEST(KineticEnergy, OfABlockAtRestOnARigidBodyIsZero) {
  Dynamics<2> dynamics({rectangle(1.0, 1.0, 0.0)}, otm<2>(), {.damping = 1.0});
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, 1.0}, 0.0)});
  EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-10);
}

TEST(KineticEnergy, OfABlockThatSupportsHoldIsZero) {
  for (const bool has_functions : {false, true}) {
    Dynamics<2> dynamics({rectangle(1.0, 1.0, 0.0, 10.0, has_functions)},
                         has_functions ? total_lagrangian<2>() : otm<2>(), {.damping = 1.0});
    dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
    EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-10);
  }
}

TEST(KineticEnergy, OfAFlatBodyThatStartsInBalanceStaysZeroAndSoDoesTheErrorOfTheBalance) {
  for (const bool on_wall : {false, true}) {
    Dynamics<2> dynamics({rectangle(2.0, 0.25, 0.0, 1000.0)}, otm<2>());
    if (on_wall)
      dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
    else
      dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
    dynamics.set_gravity({0.0, -10.0});
    dynamics.come_to_rest(1e-10, 100000);
    const double start = dynamics.balance()["stored"];
    dynamics.run(100.0 * dynamics.step());
    EXPECT_LT(std::abs(dynamics.balance()["kinetic"]), 1e-8 * start);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-6);
  }
}

TEST(KineticEnergy, ARigidBodyWaitsForAStaticStartAndThenFallsFromWhereItWas) {
  Dynamics<2> dynamics({rectangle(1.0, 1.0, 0.0, 1000.0)}, otm<2>());
  dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
  dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>({0.5, 2.0}, 0.3), .centre = {0.5, 2.0}, .mass = 1.0});
  dynamics.set_gravity({0.0, -10.0});
  dynamics.come_to_rest(1e-10, 100000);
  EXPECT_EQ(dynamics.rigid_bodies()[0].centre[1], 2.0);
  dynamics.run(0.2);
  EXPECT_NEAR(dynamics.rigid_bodies()[0].centre[1], 2.0 - 5.0 * 0.2 * 0.2, 1e-12);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-6);
}

TEST(KineticEnergy, OfABlockAtRestOnAnotherHasNothingOfFreeFall) {
  for (const bool has_wall : {true, false}) {
    Dynamics<2> dynamics({rectangle(1.0, 0.5, 0.0), rectangle(1.0, 0.5, 0.5)}, otm<2>(),
                         {.damping = 1.0, .contact = {.friction = 0.5}});
    if (has_wall)
      dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
    else
      dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
    // Contact between facets chatters; free fall in half a step has 6e-3.
    EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-4);
  }
}

TEST(KineticEnergy, OfABlockTiedToOneThatSupportsHoldIsZero) {
  auto low = rectangle(1.0, 0.5, 0.0), high = rectangle(1.0, 0.5, 0.0);
  high.nodes.row(1) = 1.0 - high.nodes.row(1).array();
  high.points.row(1) = 1.0 - high.points.row(1).array();
  for (Index c = 0; c < high.cells.cols(); ++c) std::swap(high.cells(0, c), high.cells(1, c));
  Dynamics<2> dynamics({low, high}, otm<2>(), {.tied = true, .damping = 1.0});
  dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
  EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-10);
}

TEST(KineticEnergy, OfARigidBodyAtRestOnABlockIsZero) {
  Dynamics<2> dynamics({rectangle(1.0, 1.0, 0.0)}, otm<2>(), {.damping = 1.0});
  dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, -1.0}, -1.0), .mass = 1.0});
  EXPECT_LT(kinetic_over_stored_at_rest(dynamics), 1e-10);
}

TEST(KineticEnergy, InFreeFallIsThatOfTheVelocityNowAlsoBesideABlockAtRest) {
  constexpr double g = 0.1;
  Dynamics<2> dynamics({rectangle(1.0, 0.5, 0.0), rectangle(1.0, 0.5, 3.0)}, otm<2>());
  dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1.0; }, 1, 0.0);  // all of the lower one
  dynamics.prescribe([](const Vec<2>& x) { return x[1] > 2.0; }, 0, 0.0);  // across, which nothing hinders
  dynamics.set_gravity({0.0, -g});
  for (int k = 0; k < 50; ++k) {
    dynamics.step((k % 3 == 0 ? 0.3 : 1.0) * dynamics.stable_step());
    const double t = dynamics.time();
    EXPECT_NEAR(dynamics.balance()["kinetic"], 0.25 * g * g * t * t, 1e-15);
  }
}

/// A bar 4 long whose left end stays and whose right end moves at 0.001: it has the energy of a velocity that is
/// linear.
TEST(KineticEnergy, OfABarThatIsPulledSlowlyIsThatOfALinearVelocity) {
  constexpr double v = 1e-3, L = 4.0, h = 0.5;
  Dynamics<2> dynamics({rectangle(L, h, 0.0, 1.0)}, otm<2>(), {.damping = 0.1});
  dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, 0, 0.0);
  dynamics.prescribe([](const Vec<2>& x) { return x[0] > L - 1e-9; }, 0, v);
  dynamics.run(400.0);
  const auto balance = dynamics.balance();
  EXPECT_NEAR(balance["kinetic"], 0.5 * L * h * v * v / 3.0, 0.01 * L * h * v * v / 6.0);
  // The work of the end is that of the force at the time, not of half a step ago.
  const double stretch = v * 400.0 / L;
  EXPECT_GT(balance["stored"], 0.4 * stretch * stretch * L * h);
  EXPECT_NEAR(balance["prescribed"], balance["stored"] + balance["kinetic"] + balance["damping"],
              1e-5 * balance["stored"]);
}

TEST(KineticEnergy, OfABarThatVibratesUnderGravityClosesTheBalanceWithoutDrift) {
  for (const bool has_wall : {false, true}) {
    Dynamics<2> dynamics({rectangle(0.5, 2.0, 0.0, 10.0, !has_wall)}, has_wall ? otm<2>() : total_lagrangian<2>());
    if (has_wall)
      dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
    else
      dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, 1, 0.0);
    dynamics.set_gravity({0.0, -0.01});
    dynamics.run(60.0);  // 24 periods
    const double early = std::abs(dynamics.energy().largest_error());
    dynamics.run(600.0);
    EXPECT_LT(early, has_wall ? 0.01 : 1e-4);
    EXPECT_LT(std::abs(dynamics.energy().error()), has_wall ? 0.01 : 1e-4);
  }
}

}  // namespace
}  // namespace efree
