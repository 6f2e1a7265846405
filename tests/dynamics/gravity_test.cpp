// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies under gravity: closed forms, and the same motion seen from a falling frame.
#include "efree/bench/elastic_block.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/j2.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/tests/dynamics/interrupted_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace efree {
namespace {

using bench::block;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

template <int Dim> Vec<Dim> along(double x, double y) {
  Vec<Dim> result = Vec<Dim>::Zero();
  result[0] = x;
  result[1] = y;
  return result;
}
Vec<3> in_space(const Vec<2>& of) {
  return {of[0], of[1], 0.0};
}
Vec<3> in_space(const Vec<3>& of) {
  return of;
}

/// Bodies fly along their parabola, in steps of changing length, and so does a rigid body with a mass.
template <int Dim> void expect_parabola(DeformableBody<Dim> body, const DynamicsOptions& options, const Vec<Dim>& speed,
                                        const Vec<Dim>& g) {
  body.velocity = speed.replicate(1, body.nodes.cols());
  Dynamics<Dim> dynamics({body}, body.shape ? total_lagrangian<Dim>() : otm<Dim>(), options);
  const bool has_rigid_body = !body.surface;
  if (has_rigid_body)
    dynamics.add_rigid_body({.shape = rigid_shapes::ball<Dim>(along<Dim>(0.0, -50.0), 1.0),
                             .velocity = [&](double) { return speed; },
                             .centre = along<Dim>(0.0, -50.0),
                             .mass = 2.0});
  dynamics.set_gravity(g);
  const Points<Dim> start = dynamics.nodes();
  const double mass = dynamics.masses().sum(), all = mass + (has_rigid_body ? 2.0 : 0.0);
  const auto before = dynamics.balance();
  EXPECT_NEAR(before["kinetic"], 0.5 * all * speed.squaredNorm(), 1e-13 * all);
  double dt = 0.0;
  for (int k = 0; k < 100; ++k) {
    dt = dynamics.step((k % 3 == 0 ? 0.3 : 1.0) * dynamics.stable_step());
    const double t = dynamics.time();
    const Vec<Dim> way = t * speed + 0.5 * t * t * g, now = speed + t * g, then = speed + (t - 0.5 * dt) * g;
    const auto at = dynamics.balance();
    const double size = 1e-13 * all * (1.0 + now.squaredNorm());
    ASSERT_LT(((dynamics.nodes() - start).colwise() - way).cwiseAbs().maxCoeff(), 1e-12 * (1.0 + way.norm()));
    ASSERT_LT((dynamics.velocities().colwise() - then).cwiseAbs().maxCoeff(), 1e-12 * (1.0 + then.norm()));
    ASSERT_LT((at.momentum - all * then).norm(), size);
    ASSERT_NEAR(at["kinetic"], 0.5 * all * now.squaredNorm(), size);
    ASSERT_NEAR(at["gravity"], all * g.dot(way), size);
    ASSERT_NEAR(at.total(), before.total(), 10.0 * size);
    ASSERT_LT(std::abs(dynamics.energy().error()), 1e-11);
    if (has_rigid_body) {
      ASSERT_LT((dynamics.rigid_bodies()[0].centre - along<Dim>(0.0, -50.0) - way).norm(), 1e-12 * (1.0 + way.norm()));
    }
  }
  EXPECT_EQ(dynamics.count("reconnections"), 0);
  // The angular momentum is that of the momentum, of half a step ago, at the centre of mass.
  const Vec<Dim> then = speed + (dynamics.time() - 0.5 * dt) * g;
  Vec<Dim> centre = dynamics.nodes() * dynamics.masses() / mass;
  Vec<3> angular = in_space(centre).cross(in_space(Vec<Dim>(mass * then)));
  if (has_rigid_body) angular += in_space(dynamics.rigid_bodies()[0].centre).cross(in_space(Vec<Dim>(2.0 * then)));
  const auto found = dynamics.balance().angular_momentum;
  for (int i = 0; i < found.size(); ++i)
    EXPECT_NEAR(found[i], angular[Dim == 2 ? 2 : i], 1e-11 * (1.0 + angular.norm()));
}

TEST(Gravity, FreeFallFollowsTheParabola) {
  expect_parabola<2>(deformable_body(block<2>(2.0, 0.3), soft(), 1.0), {}, {0.2, 0.5}, {0.01, -0.1});
  expect_parabola<2>(deformable_body(block<2>(2.0, 0.3), soft(), 1.0, true), {.plane = Plane::axisymmetric}, {0.0, 0.5},
                     {0.0, -0.1});
  expect_parabola<3>(deformable_body(block<3>(2.0, 0.5), soft(), 1.0), {}, {0.2, 0.5, 0.1}, {0.02, -0.1, 0.05});
  // Masses that are not lumped.
  expect_parabola<2>(
      deformable_body(approximate(block<2>(2.0, 0.08), {.spacing = 0.3, .support = dynamics_support}), soft(), 1.0), {},
      {0.2, 0.5}, {0.01, -0.1});
}

/// Metal that flies apart: nodes are inserted, and points break.
template <int Dim> Dynamics<Dim> torn() {
  const J2 metal({.moduli = {.E = 100.0, .nu = 0.3}, .yield = 0.2, .strain = Strain::finite});
  DeformableBody<Dim> body = deformable_body(block<Dim>(1.0, Dim == 2 ? 0.15 : 0.5), metal, 1.0);
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const auto x = body.nodes.col(a);
    body.velocity(0, a) = 0.2 + 1.5 * (x[0] - 0.5) - 0.5 * (x[1] - 0.5);
    body.velocity(1, a) = 0.1 - 0.5 * (x[1] - 0.5) + 0.5 * (x[0] - 0.5);
  }
  body.fracture.stretch = 1.8;
  return Dynamics<Dim>({body}, otm<Dim>({.insertion = 1.5}));
}

template <class T> class GravityIn : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(GravityIn, Dimensions);

TYPED_TEST(GravityIn, SeenFromAFallingFrameBodiesMoveAsWithoutGravity) {
  constexpr int Dim = TypeParam::value;
  Dynamics<Dim> still = torn<Dim>(), falls = torn<Dim>();
  const Vec<Dim> g = along<Dim>(0.1, -0.4);
  falls.set_gravity(g);
  const auto before = falls.balance();
  const double mass = falls.masses().sum();
  double dt = 0.0;
  while (falls.time() < 0.8) {
    dt = falls.step(0.5 * falls.stable_step());
    still.step(dt);
    ASSERT_NEAR(still.time(), falls.time(), 1e-12);
  }
  const double t = falls.time();
  EXPECT_GT(falls.count("reconnections"), 0);
  EXPECT_GT(falls.count("inserted nodes"), 0);
  EXPECT_GT(falls.count("eroded points"), 0);
  ASSERT_EQ(falls.num_nodes(), still.num_nodes());
  ASSERT_EQ(falls.count("eroded points"), still.count("eroded points"));
  const Points<Dim> moved = falls.nodes().colwise() - Vec<Dim>(0.5 * t * t * g);
  EXPECT_LT((moved - still.nodes()).cwiseAbs().maxCoeff(), 1e-9);
  const auto after = falls.balance(), other = still.balance();
  EXPECT_LT((after.momentum - before.momentum - mass * (t - 0.5 * dt) * g).norm(), 1e-13);
  EXPECT_NEAR(after.total(), other.total(), 1e-9);
  EXPECT_NEAR(after["reconnection"], other["reconnection"], 1e-9);
  EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
}

/// A block that slides on a wall, below a ball with a mass.
template <int Dim> Dynamics<Dim> loaded(bool wall_rises, const Vec<Dim>& g) {
  DeformableBody<Dim> body = deformable_body(block<Dim>(2.0, Dim == 2 ? 0.1 : 0.4), soft(), 1.0);
  body.velocity = along<Dim>(0.3, -0.1).replicate(1, body.nodes.cols());
  Dynamics<Dim> dynamics({body}, otm<Dim>({.reconnection_strain = 0.02}));
  RigidBody<Dim> wall{.shape = rigid_shapes::half_space<Dim>(Vec<Dim>::Unit(1), -0.05), .friction = 0.3};
  RigidBody<Dim> ball{.shape = rigid_shapes::ball<Dim>(along<Dim>(1.2, 1.6), 0.5),
                      .velocity = [](double) { return along<Dim>(0.0, -0.2); },
                      .centre = along<Dim>(1.2, 1.6),
                      .mass = 0.5,
                      .inertia = 0.1};
  if (wall_rises)
    wall.velocity = [g](double t) { return Vec<Dim>(-t * g); };
  else
    dynamics.set_gravity(g);
  dynamics.add_rigid_body(wall);
  dynamics.add_rigid_body(ball);
  return dynamics;
}

TYPED_TEST(GravityIn, OnAWallAtRestIsAsOnAWallThatRisesEverFaster) {
  constexpr int Dim = TypeParam::value;
  const Vec<Dim> g = along<Dim>(0.02, -0.1);
  Dynamics<Dim> heavy = loaded<Dim>(false, g), lifted = loaded<Dim>(true, g);
  while (heavy.time() < 2.0) {
    const double dt = heavy.step();
    lifted.step(dt);
    ASSERT_NEAR(lifted.time(), heavy.time(), 1e-12);  // sums of steps
  }
  const double t = heavy.time();
  EXPECT_GT(heavy.count("reconnections"), 0);
  EXPECT_GT(heavy.rigid_bodies()[1].impulse[1], 0.01);
  EXPECT_LT(heavy.rigid_bodies()[0].impulse[1], -0.1);
  const Points<Dim> moved = heavy.nodes().colwise() - Vec<Dim>(0.5 * t * t * g);
  EXPECT_LT((moved - lifted.nodes()).cwiseAbs().maxCoeff(), 1e-9);
  for (int k = 0; k < 2; ++k)
    EXPECT_LT((heavy.rigid_bodies()[k].impulse - lifted.rigid_bodies()[k].impulse).norm(), 1e-9);
  const EnergyWatch energy = heavy.energy();
  EXPECT_LT(std::abs(energy.error()), 0.01);
}

TYPED_TEST(GravityIn, ResultsAreBitwiseTheSameOnAnyNumberOfThreadsAndFromAState) {
  constexpr int Dim = TypeParam::value;
  const Vec<Dim> g = along<Dim>(0.02, -0.1);
  const auto ran = [&](int threads, bool breaks_off) {
    // Gravity is part of the state.
    return test::run_in_two(
        threads, breaks_off, 0.7, 1.5, [&] { return loaded<Dim>(false, g); },
        [&] { return loaded<Dim>(false, Vec<Dim>::Zero()); });
  };
  const Dynamics<Dim> one = ran(1, false);
  EXPECT_GT(one.balance()["gravity"], 0.0);
  for (const Dynamics<Dim>& other : {ran(3, false), ran(1, true)}) {
    EXPECT_EQ(one.nodes(), other.nodes());
    EXPECT_EQ(one.cauchy_stress(), other.cauchy_stress());
    EXPECT_EQ(one.rigid_bodies()[1].centre, other.rigid_bodies()[1].centre);
    EXPECT_EQ(one.balance()["gravity"], other.balance()["gravity"]);
    EXPECT_EQ(one.balance().total(), other.balance().total());
  }
}

/// Displacement of the end of a bar of length L, under gravity from time 0 on: g t^2 / 2 until the wave from its
/// support comes, then periodic about the displacement at rest, g L^2 / (2 c^2).
double end_of_bar(double t, double L, double g) {
  const double turn = 4.0 * L, in = std::fmod(t, turn), s = std::min(in, turn - in);
  return s < L ? 0.5 * g * s * s : g * L * L - 0.5 * g * (2.0 * L - s) * (2.0 * L - s);
}

TEST(Gravity, ABarThatIsLetHangSwingsAboutWhereItWouldRest) {
  const double L = 4.0, g = 1e-5, rest = 0.5 * g * L * L;
  const auto off = [&](double size) {
    DeformableBody<2> body = deformable_body(block<2>(L, size), soft(0.0), 1.0);
    Dynamics<2> dynamics({body}, otm<2>());
    dynamics.set_gravity({g, 0.0});
    std::vector<Index> end;
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      if (body.nodes(0, a) < 1e-9) dynamics.prescribe(a, 0, 0.0);
      if (body.nodes(0, a) > L - 1e-9) end.push_back(a);
    }
    double worst = 0.0, highest = 0.0, sum = 0.0;
    while (dynamics.time() < 8.0 * L) {
      const double dt = dynamics.step();
      double u = 0.0;
      for (const Index a : end) u += (dynamics.nodes()(0, a) - L) / static_cast<double>(end.size());
      worst = std::max(worst, std::abs(u - end_of_bar(dynamics.time(), L, g)));
      highest = std::max(highest, u);
      sum += u * dt;
    }
    EXPECT_NEAR(sum / dynamics.time(), rest, 0.01 * rest) << size;
    EXPECT_NEAR(highest, 2.0 * rest, 0.02 * rest) << size;
    const auto now = dynamics.balance();
    EXPECT_LT(std::abs(now.total()), 1e-3 * g * g * L * L * L) << size;
    EXPECT_EQ(now["prescribed"], 0.0);
    return worst / rest;
  };
  const double coarse = off(0.25), fine = off(0.125);
  EXPECT_LT(fine, 0.012);
  EXPECT_GT(std::log2(coarse / fine), 1.2) << coarse << " " << fine;
}

/// A column that stands on a wall, under gravity from time 0 on: over a period, four times that of a wave through it,
/// the wall bears the weight in the mean.
TEST(Gravity, AWallBearsTheWeightOfWhatStandsOnIt) {
  const double L = 4.0, g = 1e-5;
  Dynamics<2> dynamics(
      {deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 1.0, L), {.size = 0.125}), soft(0.0), 1.0)}, otm<2>());
  dynamics.add_wall({.normal = Vec<2>::Unit(1)});
  dynamics.set_gravity({0.0, -g});
  const double weight = g * dynamics.masses().sum();
  double last = 0.0, impulse = 0.0, first = 0.0;
  const auto until = [&](double end) {
    while (dynamics.time() < end - 1e-9) {
      const double dt = dynamics.step(end - dynamics.time());
      impulse -= 0.5 * (last + dt) * dynamics.wall_forces()(1, 0);
      last = dt;
    }
  };
  until(4.0 * L);
  first = impulse;
  EXPECT_NEAR(first, weight * dynamics.time(), 0.02 * weight * dynamics.time());
  EXPECT_NEAR(dynamics.balance().momentum[1], impulse - weight * (dynamics.time() - 0.5 * last), 1e-12 * impulse);
  until(8.0 * L);
  EXPECT_NEAR(impulse, 2.0 * first, 0.02 * first);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

/// A ball around its axis, dropped on a wall.
TEST(Gravity, ABallThatIsDroppedHitsTheWallWithTheSpeedOfItsHeight) {
  const double height = 0.5, g = 0.02;
  std::vector<Vec<2>> half;
  const int n = 24;
  for (int k = 0; k <= n; ++k) {
    const double angle = std::numbers::pi * (static_cast<double>(k) / n - 0.5);
    half.push_back(Vec<2>(k == 0 || k == n ? 0.0 : std::cos(angle), 1.0 + std::sin(angle)));
  }
  half.push_back(half.front());
  DeformableBody<2> body = deformable_body(triangulate({.boundary = {{"", half}}}, {.size = 0.12}), soft(), 1.0, true);
  Dynamics<2> dynamics({body}, otm<2>(), {.plane = Plane::axisymmetric});
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    if (body.nodes(0, a) < 1e-9) dynamics.prescribe(a, 0, 0.0);
  dynamics.add_wall({.normal = Vec<2>::Unit(1), .level = -height});
  dynamics.set_gravity({0.0, -g});
  const double mass = dynamics.masses().sum(), fall = std::sqrt(2.0 * height / g);
  double last = 0.0, impulse = 0.0;
  auto hit = dynamics.balance();
  while (dynamics.time() < 2.6 * fall) {
    if (impulse == 0.0) hit = dynamics.balance();
    const double dt = dynamics.step();
    impulse -= 0.5 * (last + dt) * dynamics.wall_forces()(1, 0);
    last = dt;
  }
  const double speed = std::sqrt(2.0 * g * height);
  EXPECT_NEAR(hit["kinetic"], 0.5 * mass * speed * speed, 0.03 * hit["kinetic"]);  // a step before
  EXPECT_NEAR(hit.total(), 0.0, 1e-12 * hit["kinetic"]);
  EXPECT_NEAR(hit["gravity"], hit["kinetic"], 1e-12 * hit["kinetic"]);
  // It flies up again, with what elastic bodies keep.
  const auto now = dynamics.balance();
  EXPECT_GT(now.momentum[1], 0.0);
  EXPECT_GT(impulse, 1.8 * mass * speed);
  EXPECT_NEAR(now.momentum[1], impulse - mass * g * (dynamics.time() - 0.5 * last), 1e-11 * impulse);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.005);
}

TEST(Gravity, RefusesInvalidAccelerations) {
  Dynamics<2> plane({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  Dynamics<2> turned({deformable_body(block<2>(1.0, 0.5), soft(), 1.0, true)}, otm<2>(),
                     {.plane = Plane::axisymmetric});
  EXPECT_THAT([&] { turned.set_gravity({0.1, 1.0}); }, ThrowsMessage<InputError>(HasSubstr("along the radius")));
  EXPECT_THROW(plane.set_gravity({0.0, std::numeric_limits<double>::quiet_NaN()}), InputError);
  plane.set_gravity({0.1, 1.0});
  turned.set_gravity({0.0, 1.0});
}

}  // namespace
}  // namespace efree
