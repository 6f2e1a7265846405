// SPDX-License-Identifier: GPL-3.0-or-later
/// Rigid tools: shapes, momentum, energy, and closed forms of what they do to bodies.
#include "efree/bench/elastic_block.hpp"
#include "efree/bench/indentation.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/otm/otm.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using bench::block;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

template <int Dim> OtmBody<Dim> thrown(const FineMesh<Dim>& mesh, const Vec<Dim>& velocity, double nu = 0.3) {
  OtmBody<Dim> body = otm_body(mesh, soft(nu), 1.0);
  body.velocity = velocity.replicate(1, body.nodes.cols());
  return body;
}

template <int Dim> std::function<Vec<Dim>(double)> always(const Vec<Dim>& velocity) {
  return [velocity](double) { return velocity; };
}

TEST(ToolShapes, GapsAreSignedDistancesAndNormalsTheirGradients) {
  const auto check = [](const auto& shape, const auto& at, double gap) {
    using Place = std::decay_t<decltype(at)>;
    const auto found = shape(at);
    EXPECT_NEAR(found.gap, gap, 1e-12);
    EXPECT_NEAR(found.normal.norm(), 1.0, 1e-12);
    for (int i = 0; i < at.size(); ++i) {
      const Place step = 1e-6 * Place::Unit(i);
      EXPECT_NEAR((shape(Place(at + step)).gap - shape(Place(at - step)).gap) / 2e-6, found.normal[i], 1e-8);
    }
  };
  const auto half = tools::half_space<2>(Vec<2>(0.6, 0.8), 1.0);
  check(half, Vec<2>(3.0, 4.0), 4.0);
  check(half, Vec<2>(0.0, 0.0), -1.0);
  const auto ball = tools::ball<3>({1.0, 0.0, 0.0}, 2.0);
  check(ball, Vec<3>(1.0, 3.0, 4.0), 3.0);
  check(ball, Vec<3>(1.5, 0.0, 0.0), -1.5);
  const auto bar = tools::cylinder({0.0, 0.0, 1.0}, {0.0, 2.0, 0.0}, 1.0);
  check(bar, Vec<3>(3.0, 7.0, 5.0), 4.0);
  check(bar, Vec<3>(0.0, -3.0, 1.5), -0.5);
  // Of either orientation: outside of a side, of a corner, inside.
  Points<2> corners(2, 4);
  corners << 0.0, 2.0, 2.0, 0.0, 0.0, 0.0, 1.0, 1.0;
  for (const bool turned : {false, true}) {
    const auto box = tools::solid<2>(turned ? Points<2>(corners.rowwise().reverse()) : corners, tools::polygon(4));
    check(box, Vec<2>(1.0, 1.5), 0.5);
    check(box, Vec<2>(2.3, 1.4), 0.5);
    check(box, Vec<2>(1.0, 0.2), -0.2);
    // On a side there is a normal too.
    EXPECT_NEAR(box(Vec<2>(1.0, 1.0)).gap, 0.0, 1e-15);
    EXPECT_NEAR((box(Vec<2>(1.0, 1.0)).normal - Vec<2>::Unit(1)).norm(), 0.0, 1e-12);
    EXPECT_GT(box(Vec<2>(100.0, 0.5)).gap, 90.0);
  }
  const FineMesh<3> cube(solids::box({1.0, 1.0, 1.0}, 0.5));
  const auto solid = tools::solid<3>(cube.vertices(), cube.facets());
  check(solid, Vec<3>(0.3, 0.4, 1.2), 0.2);
  check(solid, Vec<3>(0.3, 0.4, 0.9), -0.1);
  check(solid, Vec<3>(1.1, 1.2, 1.2), 0.3);
}

TEST(ToolShapes, ThatAreNoneAreRefused) {
  EXPECT_THROW(tools::half_space<2>(Vec<2>(1.0, 1.0), 0.0), InputError);
  EXPECT_THROW(tools::ball<2>(Vec<2>::Zero(), 0.0), InputError);
  EXPECT_THROW(tools::cylinder(Vec<3>::Zero(), Vec<3>::Zero(), 1.0), InputError);
  Points<2> corners(2, 3);
  corners << 0.0, 1.0, 2.0, 0.0, 0.0, 0.0;
  EXPECT_THAT([&] { tools::solid<2>(corners, tools::polygon(3)); }, ThrowsMessage<InputError>(HasSubstr("nothing")));
  EXPECT_THAT([&] { tools::solid<2>(corners, tools::polygon(2).leftCols(1)); },
              ThrowsMessage<InputError>(HasSubstr("not closed")));
  Otm<2> otm({thrown<2>(block<2>(1.0, 0.5), Vec<2>::Zero())});
  EXPECT_THAT([&] { otm.add_tool({}); }, ThrowsMessage<InputError>(HasSubstr("shape")));
  EXPECT_THAT([&] { otm.add_tool({.shape = tools::half_space<2>(Vec<2>::Unit(1), -1.0), .mass = -1.0}); },
              ThrowsMessage<InputError>(HasSubstr("mass")));
}

/// A block and a tool that meet at a speed, the one or the other thrown: the same but for the motion of both.
template <int Dim> void expect_that_only_relative_motion_counts(const ToolShape<Dim>& shape, double friction) {
  Vec<Dim> speed = Vec<Dim>::Zero();
  speed[0] = 0.05;
  speed[1] = 0.2;
  const auto run = [&](const Vec<Dim>& of_block, const Vec<Dim>& of_tool) {
    Otm<Dim> otm({thrown<Dim>(block<Dim>(1.0, Dim == 2 ? 0.2 : 0.4), of_block)});
    otm.add_tool({.shape = shape, .friction = friction, .velocity = always<Dim>(of_tool)});
    otm.run(1.5);
    EXPECT_GT(otm.tools()[0].impulse.norm(), 0.01);
    Points<Dim> place = otm.nodes(), velocity = otm.velocities();
    place.colwise() -= otm.time() * of_tool;
    velocity.colwise() -= of_tool;
    return std::pair(place, velocity);
  };
  const auto block_flies = run(-speed, Vec<Dim>::Zero()), tool_flies = run(Vec<Dim>::Zero(), speed);
  EXPECT_LT((block_flies.first - tool_flies.first).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((block_flies.second - tool_flies.second).cwiseAbs().maxCoeff(), 1e-11);
}

TEST(OtmTool, ThrownAtAStandingBodyIsABodyThrownAtAStandingTool) {
  for (const double friction : {0.0, 0.2, std::numeric_limits<double>::infinity()}) {
    expect_that_only_relative_motion_counts<2>(tools::half_space<2>(Vec<2>::Unit(1), -0.05), friction);
    expect_that_only_relative_motion_counts<2>(tools::ball<2>({0.4, -1.55}, 1.5), friction);
  }
  expect_that_only_relative_motion_counts<3>(tools::half_space<3>(Vec<3>::Unit(1), -0.05), 0.2);
  expect_that_only_relative_motion_counts<3>(tools::cylinder({0.5, -1.05, 0.0}, {0.0, 0.0, 1.0}, 1.0), 0.2);
}

/// A tool that turns hits a block off its middle, with friction.
template <int Dim> Otm<Dim> struck(const OtmTool<Dim>& tool) {
  Otm<Dim> otm({thrown<Dim>(block<Dim>(2.0, Dim == 2 ? 0.2 : 0.4), Vec<Dim>::Unit(1) * 0.02)});
  otm.add_tool(tool);
  return otm;
}
Points<2> gear() {
  Points<2> corners(2, 8);
  for (int k = 0; k < 8; ++k)
    corners.col(k) =
        Vec<2>(1.5, 1.6) + 0.5 * Vec<2>(std::cos(k * std::numbers::pi / 4), std::sin(k * std::numbers::pi / 4));
  return corners;
}
template <int Dim> OtmTool<Dim> turning() {
  OtmTool<Dim> tool{.shape = {}, .friction = 0.3, .velocity = always<Dim>(-0.15 * Vec<Dim>::Unit(1))};
  if constexpr (Dim == 2) {
    tool.shape = tools::solid<2>(gear(), tools::polygon(8));
    tool.centre = Vec<2>(1.5, 1.6);
    tool.spin = always<1>(Vec<1>(0.3));
  } else {
    tool.centre = Vec<3>(1.5, 1.6, 0.4);
    tool.shape = tools::ball<3>(tool.centre, 0.55);
    tool.spin = [](double) { return Vec<3>(0.1, 0.2, -0.3); };
  }
  return tool;
}

template <class T> class OtmToolIn : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(OtmToolIn, Dimensions);

TYPED_TEST(OtmToolIn, GivesBodiesItsImpulseAndItsWork) {
  constexpr int Dim = TypeParam::value;
  auto otm = struck<Dim>(turning<Dim>());
  const auto before = otm.balance();
  Vec<Dim> impulse = Vec<Dim>::Zero();
  double last = 0.0;
  while (otm.time() < 3.0) {
    const double dt = otm.step();
    impulse += 0.5 * (dt + last) * otm.tools()[0].force;
    last = dt;
  }
  const auto after = otm.balance();
  const ToolState<Dim> tool = otm.tools()[0];
  EXPECT_GT(tool.impulse.norm(), 0.05);
  EXPECT_LT((impulse - tool.impulse).norm(), 1e-13);
  EXPECT_LT((after.momentum - before.momentum + tool.impulse).norm(), 1e-13);
  EXPECT_NEAR(after.prescribed, tool.work, 1e-15);
  EXPECT_GT(tool.work, 0.0);
  EXPECT_NEAR(after.total(), before.total(), 0.01 * tool.work);
  EXPECT_NEAR((tool.centre - turning<Dim>().centre).norm(), 0.15 * otm.time(), 1e-12);
}

TYPED_TEST(OtmToolIn, WithAMassKeepsBothMomentaOfAllToRounding) {
  constexpr int Dim = TypeParam::value;
  OtmTool<Dim> tool = turning<Dim>();
  tool.mass = 0.6;
  tool.inertia = 0.1;
  auto otm = struck<Dim>(tool);
  const auto before = otm.balance();
  EXPECT_NEAR(before.momentum[1], 0.02 * otm.masses().sum() - 0.15 * 0.6, 1e-13);
  otm.run(4.0);
  const auto after = otm.balance();
  EXPECT_GT(otm.tools()[0].velocity[1], 0.0);  // it is thrown back
  EXPECT_GT((otm.tools()[0].spin - tool.spin(0.0)).norm(), 0.02);
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-13);
  EXPECT_LT((after.moment - before.moment).norm(), 1e-12);
  EXPECT_EQ(after.prescribed, 0.0);
  EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
  EXPECT_GT(after.contact, 0.0);
}

TYPED_TEST(OtmToolIn, GoesOnFromAStateBitwise) {
  constexpr int Dim = TypeParam::value;
  OtmTool<Dim> tool = turning<Dim>();
  tool.mass = 0.6;
  auto one = struck<Dim>(tool), other = struck<Dim>(tool);
  one.run(1.0);
  other.restore(one.state());
  one.run(2.0);
  other.run(2.0);
  EXPECT_EQ(one.nodes(), other.nodes());
  EXPECT_EQ(one.tools()[0].centre, other.tools()[0].centre);
  EXPECT_EQ(one.tools()[0].turned, other.tools()[0].turned);
  EXPECT_EQ(one.tools()[0].impulse, other.tools()[0].impulse);
  EXPECT_EQ(one.balance().total(), other.balance().total());
  Otm<Dim> without({thrown<Dim>(block<Dim>(2.0, Dim == 2 ? 0.2 : 0.4), Vec<Dim>::Unit(1) * 0.02)});
  EXPECT_THROW(without.restore(one.state()), InputError);
}

/// A plate lifts a block with the acceleration g, under which the block slides: px + mu py stays, and py is m g t but
/// for what vibrates in the block.
TEST(OtmTool, ABlockOnAnAcceleratedPlateSlidesWithMuTimesItsAcceleration) {
  const double g = 0.02, mu = 0.25;
  Otm<2> otm({thrown<2>(block<2>(2.0, 0.25), Vec<2>(0.3, 0.0))});
  otm.add_tool({.shape = tools::half_space<2>(Vec<2>::Unit(1), 0.0), .friction = mu, .velocity = [g](double t) {
                  return Vec<2>(0.0, g * t);
                }});
  const double start = otm.balance().momentum[0];
  double worst = 0.0;
  while (otm.time() < 20.0) {
    otm.step();
    const Vec<2> l = otm.balance().momentum;
    worst = std::max(worst, std::abs(l[0] + mu * l[1] - start));
  }
  EXPECT_LT(worst, 1e-13);
  const Vec<2> speed = otm.balance().momentum / otm.masses().sum();
  EXPECT_NEAR(speed[1], g * otm.time(), g);
  EXPECT_NEAR(speed[0], 0.3 - mu * g * otm.time(), mu * g);
  EXPECT_NEAR(otm.balance().contact, 0.3 * mu * 2.0 * g * 20.0 - 0.5 * 2.0 * std::pow(mu * g * 20.0, 2), 3e-3);
}

/// And it goes with a plate that slides away with less than mu g, or sticks. While it bounces on the plate it slips now
/// and then.
TEST(OtmTool, ABlockGoesWithAPlateThatAcceleratesByLessThanFrictionBears) {
  const double g = 0.02, along = 0.002;
  for (const double friction : {0.25, std::numeric_limits<double>::infinity()}) {
    Otm<2> otm({thrown<2>(block<2>(2.0, 0.25), Vec<2>::Zero())});
    otm.add_tool({.shape = tools::half_space<2>(Vec<2>::Unit(1), 0.0), .friction = friction, .velocity = [=](double t) {
                    return Vec<2>(along * t, g * t);
                  }});
    const double start = otm.nodes().row(0).mean();
    otm.run(20.0);
    EXPECT_NEAR(otm.balance().momentum[0] / otm.masses().sum(), along * 20.0, 2.0 * along) << friction;
    EXPECT_NEAR(otm.nodes().row(0).mean() - start, 0.5 * along * 400.0, 8.0 * along) << friction;
  }
}

/// A rigid mass M hits the end of a bar: V = V0 exp(-rho c A t / M) until the wave comes back (Saint-Venant 1867).
TEST(OtmTool, ARigidMassThatHitsABarIsSlowedDownAsSaintVenantSaysAndBounces) {
  const double V0 = 1e-3, M = 2.0;
  const auto off = [&](double size) {
    Otm<2> otm({thrown<2>(triangulate(shapes::rectangle(0.0, 0.0, 6.0, 1.0), {.size = size}), Vec<2>::Zero(), 0.0)});
    otm.add_wall({.normal = -Vec<2>::Unit(0), .level = -6.0});
    otm.add_tool(
        {.shape = tools::half_space<2>(Vec<2>::Unit(0), 0.0), .velocity = always<2>(V0 * Vec<2>::Unit(0)), .mass = M});
    const auto before = otm.balance();
    double worst = 0.0;
    while (otm.time() < 11.0) {
      const double dt = otm.step();
      // Velocities are those in the middle of the step.
      const double exact = V0 * std::exp(-(otm.time() - 0.5 * dt) / M);
      worst = std::max(worst, std::abs(otm.tools()[0].velocity[0] - exact) / V0);
    }
    otm.run(40.0);
    EXPECT_LT(otm.tools()[0].velocity[0], -0.5 * V0);
    EXPECT_EQ(otm.tools()[0].force[0], 0.0);
    EXPECT_NEAR(otm.balance().total(), before.total(), 0.01 * before.total());
    return worst;
  };
  const double coarse = off(0.3), fine = off(0.15);
  EXPECT_LT(fine, 0.02);
  EXPECT_GT(coarse / fine, 1.4) << coarse << " " << fine;
}

/// Contact radii of 3.4 to 4.7 and of 6.7 to 8.1 spacings, as the force swings with how many nodes there are in them.
/// Where the half-space ends a point load would push it by 0.0058 of the depth, in the mean over axis and surface
/// (Boussinesq 1885), so the force is larger by 1.5 times that. Without exact integration careless meshes are too soft
/// by a tenth, whatever the spacing.
TEST(OtmTool, ABallThatIsPressedIntoAHalfSpaceFeelsTheForceOfHertz) {
  const auto off = [](Index cells, double careless, const OtmOptions& options = {}) {
    const bench::Indentation::Answer answer = bench::Indentation::press(cells, options, careless);
    EXPECT_LT(std::abs(answer.energy), 1e-4);
    return answer.force - 1.0087;
  };
  const auto mean = [&](Index from, double careless) {
    double sum = 0.0;
    for (Index k = 0; k < 5; ++k) sum += off(from + k, careless);
    return sum / 5.0;
  };
  const int threads = num_threads();
  set_num_threads(1);  // bodies this small gain nothing by two, and wait where others work
  for (const double careless : {0.0, 0.2}) {
    const double coarse = mean(10, careless), fine = mean(20, careless);
    EXPECT_LT(std::abs(fine), careless > 0.0 ? 0.03 : 0.015);
    EXPECT_LT(std::abs(fine), 0.5 * std::abs(coarse)) << coarse << " " << fine;
  }
  EXPECT_LT(off(20, 0.2, {.exact_integration = false}), -0.08);
  set_num_threads(threads);
}

/// A cylinder of metal between plates, pressed by a tenth so slowly that inertia takes 0.3 %: the mean pressure over
/// the yield stress.
double upsetting_pressure(double friction, double size) {
  const double R = 2.0, h = 1.0, yield = 1.0;
  const J2 metal({.moduli = {.E = 500.0, .nu = 0.3}, .yield = Hardening::linear(yield, 0.0), .strain = Strain::finite});
  Otm<2> otm(
      {otm_body(triangulate(shapes::rectangle(0.0, 0.0, R, h), {.size = size}), SharedMaterial(metal), 1.0, true)},
      {.plane = Plane::axisymmetric});
  for (Index a = 0; a < otm.num_nodes(); ++a)
    if (otm.nodes()(0, a) == 0.0) otm.prescribe(a, 0, 0.0);
  for (const double side : {-1.0, 1.0})
    otm.add_tool({.shape = tools::half_space<2>(-side * Vec<2>::Unit(1), side > 0.0 ? -h : 0.0),
                  .friction = friction,
                  .velocity = [=](double t) { return Vec<2>(0.0, -side * 0.025 * std::min(1.0, t)); }});
  otm.run(2.5);
  const Vec<2> before = otm.tools()[1].impulse;
  const double start = otm.time(), height = otm.tools()[1].centre[1] - otm.tools()[0].centre[1] + h;
  EXPECT_NEAR(height, 0.9, 1e-6);
  otm.run(2.9);
  const double force = (otm.tools()[1].impulse - before)[1] / (otm.time() - start);
  const double radius2 = R * R * h / (height - 0.01);
  const auto now = otm.balance();
  EXPECT_NEAR(now.total(), 0.0, 0.01 * now.prescribed);
  EXPECT_NEAR(now.dissipated + now.contact, now.prescribed, 0.05 * now.prescribed);
  EXPECT_NEAR(otm.tools()[0].impulse[1], -otm.tools()[1].impulse[1], 0.02 * otm.tools()[1].impulse[1]);
  return force / (std::numbers::pi * radius2 * yield);
}

/// Slabs in balance (Siebel 1923): p = 2 / m^2 (exp(m) - 1 - m) with m = 2 mu R / h.
TEST(OtmTool, UpsettingTakesThePressureOfSlabsInBalance) {
  EXPECT_NEAR(upsetting_pressure(0.0, 0.12), 1.0, 0.01);
  const double h = 0.89, m = 0.2 * 2.0 / std::sqrt(h) / h;
  EXPECT_NEAR(upsetting_pressure(0.1, 0.12), 2.0 / (m * m) * (std::exp(m) - 1.0 - m), 0.02);
}

/// Clouds have points of a surface, between which tools do not get either.
TEST(OtmTool, MeetsTheSurfacesOfCloudsToo) {
  const FineMesh<2> mesh = block<2>(2.0, 0.08);
  const auto run = [&](const ToolShape<2>& shape, const Vec<2>& of_body, const Vec<2>& of_tool) {
    OtmBody<2> body = otm_body(approximate(mesh, {.spacing = 0.3}), soft(), 1.0);
    body.velocity = of_body.replicate(1, body.nodes.cols());
    Otm<2> otm({body});
    otm.add_tool({.shape = shape, .friction = 0.2, .velocity = always<2>(of_tool)});
    const auto before = otm.balance();
    otm.run(1.5);
    const auto after = otm.balance();
    EXPECT_LT((after.momentum - before.momentum + otm.tools()[0].impulse).norm(), 1e-12);
    EXPECT_GT(otm.tools()[0].impulse.norm(), 0.02);
    EXPECT_NEAR(after.total(), before.total(), 0.01 * std::max(before.kinetic, after.prescribed));
    return Points<2>(otm.nodes().colwise() - otm.time() * of_tool);
  };
  const Vec<2> speed(0.05, 0.1);
  for (const auto& shape : {tools::half_space<2>(Vec<2>::Unit(1), 0.0), tools::ball<2>({0.8, -2.0}, 2.0)}) {
    const Points<2> body_flies = run(shape, -speed, Vec<2>::Zero()), tool_flies = run(shape, Vec<2>::Zero(), speed);
    EXPECT_LT((body_flies - tool_flies).cwiseAbs().maxCoeff(), 1e-10);
  }
  OtmBody<2> body = otm_body(approximate(mesh, {.spacing = 0.3}), soft(), 1.0);
  Otm<2> otm({body});
  EXPECT_THAT(
      [&] {
        otm.add_tool({.shape = tools::ball<2>({0.8, -2.0}, 2.0), .mass = 1.0});
      },
      ThrowsMessage<InputError>(HasSubstr("on a cloud")));
}

}  // namespace
}  // namespace efree
