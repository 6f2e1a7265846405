// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

/// A run has a deformable body, far away here.
Dynamics<2> far_away() {
  const auto mesh = triangulate(shapes::rectangle(100.0, 100.0, 101.0, 101.0), {.size = 0.5});
  return Dynamics<2>({deformable_body(mesh, NeoHookean({.E = 1e4, .nu = 0.3}), 1.0)}, otm<2>());
}

RigidBody<2> disc(const Vec<2>& centre, double radius, double mass) {
  RigidBody<2> body{.shape = rigid_shapes::ball<2>(centre, radius), .centre = centre, .mass = mass};
  body.inertia = 0.5 * mass * radius * radius;
  body.corners = centre;
  body.round = radius;
  return body;
}

TEST(RigidPairs, DiscsThatMeetHeadOnMoveOnTogetherAndKeepTheirMomentum) {
  Dynamics<2> dynamics = far_away();
  RigidBody<2> left = disc({-1.0, 0.0}, 0.5, 2.0), right = disc({1.0, 0.0}, 0.5, 1.0);
  left.velocity = [](double) { return Vec<2>(1.0, 0.0); };
  dynamics.add_rigid_body(left);
  dynamics.add_rigid_body(right);
  const double before = dynamics.balance()["kinetic"];
  dynamics.run(2.0);
  const auto states = dynamics.rigid_bodies();
  EXPECT_NEAR(states[0].velocity[0], 2.0 / 3.0, 1e-9);
  EXPECT_NEAR(states[1].velocity[0], 2.0 / 3.0, 1e-9);
  EXPECT_GT((states[0].centre - states[1].centre).norm(), 1.0 - 1e-9);
  // 1/2 m1 m2 / (m1 + m2) v^2.
  EXPECT_NEAR(dynamics.balance()["contact"], 1.0 / 3.0, 1e-9);
  EXPECT_NEAR(dynamics.balance().total(), before, 1e-9);
  ASSERT_EQ(dynamics.contacts().size(), 1);
  EXPECT_NEAR(dynamics.contacts()[0].impulse[0], -2.0 / 3.0, 1e-9);
}

TEST(RigidPairs, ADiscThatSlidesOnAPlaneRollsInTheEnd) {
  Dynamics<2> dynamics = far_away();
  RigidBody<2> ball = disc({0.0, 0.5}, 0.5, 2.0);
  ball.friction = 0.3;
  ball.velocity = [](double) { return Vec<2>(1.0, 0.0); };
  dynamics.add_rigid_body(ball);
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, 1.0}, 0.0), .friction = 0.3});
  dynamics.set_gravity({0.0, -10.0});
  dynamics.run(1.0);
  const auto state = dynamics.rigid_bodies()[0];
  EXPECT_NEAR(state.velocity[0], 2.0 / 3.0, 1e-3 * 2.0 / 3.0);
  EXPECT_NEAR(state.spin[0], -2.0 / 3.0 / 0.5, 1e-3 * 4.0 / 3.0);
  EXPECT_NEAR(state.centre[1], 0.5, 1e-4);
  // Until then it slid: v = 1 - mu g t, so that it rolls from t = 1 / (9 mu g / 3) on; friction took a third.
  EXPECT_NEAR(dynamics.balance()["friction"], 1.0 / 3.0, 0.02 / 3.0);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TEST(RigidPairs, APolygonStandsOnAPlaneOrSlidesDownItByCoulombsLaw) {
  for (const double mu : {0.3, 0.8}) {
    Dynamics<2> dynamics = far_away();
    Points<2> corners(2, 4);
    corners << -0.5, 0.5, 0.5, -0.5, 0.0, 0.0, 0.5, 0.5;
    RigidBody<2> block{.shape = rigid_shapes::solid<2>(corners, rigid_shapes::polygon(4)),
                       .friction = mu,
                       .centre = {0.0, 0.25},
                       .mass = 1.0,
                       .inertia = 0.1};
    block.corners = corners;
    dynamics.add_rigid_body(block);
    dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, 1.0}, 0.0), .friction = mu});
    dynamics.set_gravity({5.0, -8.66});
    dynamics.run(1.0);
    const double exact = std::max(0.0, 5.0 - mu * 8.66);
    EXPECT_NEAR(dynamics.rigid_bodies()[0].velocity[0], exact, 0.01 * exact + 1e-6) << mu;
    EXPECT_NEAR(dynamics.rigid_bodies()[0].spin[0], 0.0, 1e-6) << mu;
  }
}

TEST(RigidBody, GuidedOneMovesAlongItsAxesUnderItsForce) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.25});
  DynamicsOptions options;
  options.rest_from = 0.0;
  Dynamics<2> dynamics({deformable_body(mesh, NeoHookean({.E = 1e3, .nu = 0.0}), 1.0)}, otm<2>(), options);
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>(Vec<2>(0.1, -1.0).normalized(), -1.06),
                           .centre = {0.5, 1.2},
                           .mass = 0.5,
                           .held = {true, false},
                           .force = [](double) { return Vec<2>(3.0, -20.0); }});
  dynamics.run(4.0);
  const auto state = dynamics.rigid_bodies()[0];
  EXPECT_EQ(state.centre[0], 0.5);
  EXPECT_LT(state.centre[1], 1.2);
  EXPECT_THAT(
      [&] {
        dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, -1.0}, -9.0),
                                 .force = [](double) { return Vec<2>(1.0, 0.0); }});
      },
      ThrowsMessage<InputError>(HasSubstr("a force is for one with a mass")));
}

}  // namespace
}  // namespace efree
