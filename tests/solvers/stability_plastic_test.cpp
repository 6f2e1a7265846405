// SPDX-License-Identifier: GPL-3.0-or-later
// Where plastic flow breaks methods: coarse versions of bench_stability_plastic, at the defaults of the program.
#include "efree/bench/large_strains.hpp"
#include "efree/bench/plastic_limits.hpp"
#include "efree/bench/plastic_walls.hpp"
#include "efree/materials/rankine.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <vector>

namespace efree {
namespace {

using namespace bench;

/// Slope of the last fifth of a path over the first one.
template <class Load> double tail(const std::vector<HistoryStep<2>>& history, const Load& load) {
  double at_80 = 0.0;
  for (const auto& step : history)
    if (step.time <= 0.8 + 1e-9) at_80 = load(step);
  return (load(history.back()) - at_80) / 0.2 / (load(history.front()) / history.front().time);
}

TEST(PlasticLimits, ThickSphereFollowsHillsPathToItsLimitPressureAndNoFurther) {
  const Metal metal;
  const PressedWall wall = PressedWall::sphere_of_revolution;
  const double u = 0.015, limit = sphere_limit(metal);
  const auto result = analyse(mesh_of<2>(wall, 0.02),
                              wall_settings<2>(wall, metal, {.spacing = 1.0 / 15.0},
                                               {.displacement = [u](double t) { return u * t; }}, {.step = 0.05}));
  ASSERT_EQ(result.stopped, "");
  SphereInBothDirections exact(metal);
  for (const auto& step : result.history) {
    exact.bore_to(u * step.time);
    EXPECT_NEAR(bore_pressure(wall, step), exact.pressure(), 0.01 * limit) << step.time;
  }
  EXPECT_NEAR(bore_pressure(wall, result.history.back()), limit, 0.01 * limit);
  EXPECT_LT(tail(result.history, [&](const auto& step) { return bore_pressure(wall, step); }), 0.005);
}

TEST(PlasticLimits, ThickTubeInPlaneStrainFollowsHillsPathToItsLimitPressure) {
  const Metal metal{.nu = 0.4999};
  const double u = 0.0045, limit = TubeYieldedTo::limit(metal);
  const auto result = analyse(mesh_of<2>(PressedWall::tube, 0.02),
                              wall_settings<2>(PressedWall::tube, metal, {.spacing = 1.0 / 12.0},
                                               {.displacement = [u](double t) { return u * t; }}, {.step = 0.05}));
  ASSERT_EQ(result.stopped, "");
  for (const auto& step : result.history)
    EXPECT_NEAR(bore_pressure(PressedWall::tube, step), TubeYieldedTo::pressure_at(metal, u * step.time), 0.01 * limit)
        << step.time;
}

TEST(PlasticLimits, StripFootingComesToPrandtlsLoadAndNoFurther) {
  const LimitCase body = footing({}, {0.25, 1.0 / 64.0});
  const auto result = analyse(body.mesh, body.settings);
  ASSERT_EQ(result.stopped, "");
  EXPECT_NEAR(body.stress(result.history.back()), body.limit, 0.03 * body.limit);
  EXPECT_LT(tail(result.history, [&](const auto& step) { return body.stress(step); }), 0.02);
}

TEST(PlasticLimits, NotchedStripInPlaneStrainComesToItsLimitLoadAndNoFurther) {
  const LimitCase body = notched_strip({}, {0.4, 1.0 / 128.0});
  const auto result = analyse(body.mesh, body.settings);
  ASSERT_EQ(result.stopped, "");
  EXPECT_NEAR(body.stress(result.history.back()), body.limit, 0.03 * body.limit);
  EXPECT_LT(tail(result.history, [&](const auto& step) { return body.stress(step); }), 0.02);
}

/// Kinematic hardening makes loops that close after the first quarter; every radius of a sphere yields by itself.
TEST(CyclicPlasticity, SphereThatHardensKinematicallyGoesRoundClosedLoops) {
  const Metal metal{.kinematic = 20.0};
  const PressedWall wall = PressedWall::sphere_of_revolution;
  const double u = 0.008;
  // 0, u, -u, u, -u, u
  const auto bore = [u](double t) {
    return t < 1.0 ? u * t : u * (2.0 * std::abs(1.0 - std::fmod(t - 1.0, 2.0)) - 1.0);
  };
  const auto result =
      analyse(mesh_of<2>(wall, 0.02),
              wall_settings<2>(wall, metal, {.spacing = 1.0 / 15.0}, {.displacement = bore},
                               {.end = 5.0, .step = 0.25, .max_step = 0.25, .stops = {1.0, 2.0, 3.0, 4.0, 5.0}}));
  ASSERT_EQ(result.stopped, "");
  SphereInBothDirections exact(metal);
  double largest = 0.0;
  std::vector<double> turns;
  for (const auto& step : result.history) {
    exact.bore_to(bore(step.time));
    const double p = bore_pressure(wall, step);
    largest = std::max(largest, std::abs(exact.pressure()));
    EXPECT_NEAR(p, exact.pressure(), 0.01 * largest) << step.time;
    if (step.time == std::floor(step.time)) turns.push_back(p);
  }
  ASSERT_EQ(turns.size(), 5u);
  EXPECT_NEAR(turns[4], turns[2], 1e-4 * largest) << "the loop is closed";
}

TEST(CyclicPlasticity, BentBarSpringsBackToTheResidualStressOfBeamTheory) {
  const BentBar bar;
  const FineMesh<2> mesh = bar.mesh(0.0125);
  const auto result = analyse(mesh, bar.settings({.spacing = 0.05}));
  ASSERT_EQ(result.stopped, "");
  for (const auto& step : result.history) {
    const double moment = std::abs(step.reactions.at("right").moment[0]);
    if (step.time == 1.0) {
      EXPECT_NEAR(moment, bar.moment(), 0.01 * bar.moment());
    } else if (step.time == 2.0) {
      EXPECT_NEAR(moment, 0.0, 0.01 * bar.moment());
    }
  }
  double error = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const double miss = result.fields.stress(0, v) - bar.residual_stress(mesh.vertex(v)[1]);
    error += miss * miss / mesh.num_vertices();
  }
  EXPECT_LT(std::sqrt(error), 0.01 * bar.metal.yield);
}

TEST(CyclicPlasticity, SphereUnloadedFromBeyondYieldKeepsHillsResidualStress) {
  const Metal metal;
  const PressedWall wall = PressedWall::sphere_of_revolution;
  const double most = 0.8 * sphere_limit(metal);
  const FineMesh<2> mesh = mesh_of<2>(wall, 0.01);
  const auto result =
      analyse(mesh, wall_settings<2>(wall, metal, {.spacing = 0.025},
                                     {.pressure = [most](double t) { return most * (1.0 - std::abs(1.0 - t)); }},
                                     {.end = 2.0, .step = 0.1, .stops = {1.0}}));
  ASSERT_EQ(result.stopped, "");
  SphereInBothDirections exact(metal);
  exact.load(most);
  exact.load(0.0);
  double error = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<2> x = mesh.vertex(v), n = x.normalized(), should = exact.stress(x.norm());
    const Voigt<2> s = result.fields.stress.col(v);  // rr, zz, tt, rz
    const double radial = n[0] * n[0] * s[0] + n[1] * n[1] * s[1] + 2.0 * n[0] * n[1] * s[3];
    error += (std::pow(radial - should[0], 2) + std::pow(s[2] - should[1], 2)) / mesh.num_vertices();
  }
  EXPECT_LT(std::sqrt(error), 0.01 * metal.yield);
}

/// By a cloud of this spacing.
Result<2> solved(const LargeCase& body, double spacing) {
  Settings<2> settings = body.settings;
  settings.common.approximation.spacing = spacing;
  auto result = analyse(triangulate(body.domain, {.size = spacing / 3.0}), settings);
  EXPECT_EQ(result.stopped, "") << body.name;
  for (const auto& step : result.history) EXPECT_GT(step.smallest_jacobian, 0.0) << body.name;
  return result;
}
// References: quadratic elements, refined until they stay (bench_stability_plastic large).

TEST(LargeStrains, SquareIsPulledToTenTimesItsLength) {
  const LargeCase body = pulled_square();
  EXPECT_NEAR(body.force(solved(body, 0.2).history.back()), 3.8639, 0.02 * 3.8639);
}

TEST(LargeStrains, BeamIsBentToAFullCircle) {
  const auto result = solved(bent_to_circle(), 0.2);
  EXPECT_NEAR(result.history.back().stored, 0.17452, 0.02 * 0.17452);
}

TEST(LargeStrains, NearlyIncompressibleCookDoesNotLock) {
  const LargeCase body = cook_rubber();
  EXPECT_NEAR(body.force(solved(body, 5.0).history.back()), 6.965, 0.02 * 6.965);
}

/// The energy that tearing takes depends on the spacing (docs/stability.md), and the program says so.
TEST(Softening, WhatTearsIsWarnedOf) {
  const auto warnings = [](double softening) {
    Settings<2> settings;
    settings.common.model.material =
        Rankine({.moduli = {.E = 100.0, .nu = 0.0}, .strength = 0.3, .softening = softening, .strain = Strain::small});
    settings.common.model.plane = Plane::strain;
    settings.common.approximation.spacing = 0.5;
    settings.supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), moved_by("right", 0.0045, 0.0)};
    settings.supports[2].components[1] = {};
    return analyse(triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2}), settings).warnings;
  };
  using ::testing::Contains, ::testing::HasSubstr, ::testing::Not;
  EXPECT_THAT(
      warnings(5.0),
      Contains(HasSubstr("Loads beyond the peak and the dissipated energy may be too large by a factor of two")));
  EXPECT_THAT(warnings(0.0), Not(Contains(HasSubstr("softens"))));
}

}  // namespace
}  // namespace efree
