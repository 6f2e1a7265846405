// SPDX-License-Identifier: GPL-3.0-or-later
/// Riemann's problem of a perfect gas.
#include "efree/bench/shock_tube.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using bench::RiemannProblem, bench::ShockTube;

TEST(RiemannProblem, SodsTubeHasItsPublishedStates) {
  const auto sod = RiemannProblem::sod();
  EXPECT_NEAR(sod.middle().pressure, 0.303130, 5e-7);
  EXPECT_NEAR(sod.middle().velocity, 0.927453, 5e-7);
  EXPECT_NEAR(sod.at(0.9).density, 0.426319, 5e-7);
  EXPECT_NEAR(sod.at(0.95).density, 0.265574, 5e-7);
  EXPECT_EQ(sod.at(1.752157).density, 0.125) << "ahead of the shock";
  EXPECT_NEAR(sod.at(1.752155).density, 0.265574, 5e-7) << "behind it";
  EXPECT_EQ(sod.at(-1.1833).density, 1.0) << "ahead of the fan";
}

TEST(RiemannProblem, WavesConserveMassMomentumAndEnergy) {
  // What flows into an interval that all waves are in is what it gains: the exact solution's integral form.
  for (const auto& problem : {RiemannProblem::sod(), RiemannProblem::lax(), RiemannProblem::collision()}) {
    const auto conserved = [&](const RiemannProblem::Gas& gas) {
      return Vec<3>(gas.density, gas.density * gas.velocity,
                    gas.pressure / (problem.gamma - 1.0) + 0.5 * gas.density * gas.velocity * gas.velocity);
    };
    const auto flux = [&](const RiemannProblem::Gas& gas) {
      Vec<3> result = gas.velocity * conserved(gas);
      result[1] += gas.pressure;
      result[2] += gas.pressure * gas.velocity;
      return result;
    };
    const double reach = 5.0;
    constexpr int parts = 400000;
    const auto middle = problem.middle();
    Vec<3> held = Vec<3>::Zero();
    for (int k = 0; k < parts; ++k)
      held += 2.0 * reach / parts * conserved(problem.at(reach * (2.0 * (k + 0.5) / parts - 1.0), middle));
    const Vec<3> expected =
        reach * (conserved(problem.left) + conserved(problem.right)) + flux(problem.left) - flux(problem.right);
    EXPECT_LT((held - expected).norm(), 1e-4 * expected.norm());
  }
}

TEST(ShockTube, ErrorsFallAsTheyDoWhereSolutionsJump) {
  // Jumps that are a few points wide: order one in L1; in L2 one half. Within a third of finite elements' errors.
  for (const bool elements : {false, true}) {
    const auto of = [&](Index points) {
      ShockTube tube(RiemannProblem::sod(), points, ShockTube::defaults(), elements);
      const double before = tube.otm.balance().total();
      const auto errors = tube.run();
      const auto after = tube.otm.balance();
      EXPECT_GT(tube.otm.counts().renewals, elements ? -1 : points / 4);
      // By that of a tube of height 1; its internal energy is 1.375.
      EXPECT_LT(std::abs(after.total() - before) * points, 1.4e-4 * 100.0 / points);
      EXPECT_NEAR(after.viscous * points, 0.0057, 0.0014) << "the heat of the shock does not depend on the points";
      return errors;
    };
    const auto coarse = of(100), fine = of(800);
    const auto order = [](double a, double b) { return std::log(a / b) / std::log(8.0); };
    EXPECT_NEAR(order(coarse.density, fine.density), 0.95, 0.1) << elements;
    EXPECT_NEAR(order(coarse.pressure, fine.pressure), 0.95, 0.1) << elements;
    EXPECT_NEAR(order(coarse.velocity, fine.velocity), 0.55, 0.05) << elements;
    EXPECT_LT(fine.density, elements ? 1.0e-3 : 1.4e-3);
    EXPECT_LT(fine.velocity, 0.021);
  }
}

TEST(ShockTube, WavesThatAllMoveAndStreamsThatMeetAreMetAsWell) {
  for (const auto& [problem, density, velocity] :
       {std::tuple{RiemannProblem::lax(), 0.0030, 0.046}, {RiemannProblem::collision(), 0.0065, 0.044}}) {
    ShockTube tube(problem, 400, ShockTube::defaults());
    const auto errors = tube.run();
    EXPECT_LT(errors.density, density);
    EXPECT_LT(errors.velocity, velocity);
    EXPECT_GT(errors.velocity, 0.5 * velocity) << "a shock is a few points wide";
  }
}

}  // namespace
}  // namespace efree
