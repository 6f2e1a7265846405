// SPDX-License-Identifier: GPL-3.0-or-later
/// Riemann's problem of a perfect gas.
#include "efree/bench/shock_tube.hpp"

#include "efree/materials/j2.hpp"

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
      ShockTube tube(RiemannProblem::sod(), points, elements);
      const double before = tube.dynamics.balance().total();
      const auto errors = tube.run();
      const auto after = tube.dynamics.balance();
      EXPECT_GT(tube.dynamics.count("reconnections"), elements ? -1 : points / 4);
      // By that of a tube of height 1; its internal energy is 1.375.
      EXPECT_LT(std::abs(after.total() - before) * points, 1.4e-4 * 100.0 / points);
      EXPECT_NEAR(after["viscous"] * points, 0.0057, 0.0014) << "the heat of the shock does not depend on the points";
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
    ShockTube tube(problem, 400);
    const auto errors = tube.run();
    EXPECT_LT(errors.density, density);
    EXPECT_LT(errors.velocity, velocity);
    EXPECT_GT(errors.velocity, 0.5 * velocity) << "a shock is a few points wide";
  }
}

TEST(StableStep, StaysBelowItsBoundWhenNodesAreHeld) {
  // Elements of gas that move along x only: 2 over the highest frequency is h / c, and steps are at most half of that.
  constexpr Index cells = 40;
  for (const bool elements : {false, true}) {
    ShockTube tube({{1.0, 0.0, 1.0}, {1.0, 0.0, 1.0}, 1.4, 1.0}, cells, elements, ShockTube::scheme_options(), {});
    const double bound = 0.5 / cells / std::sqrt(1.4);
    for (int k = 0; k < 40; ++k) {
      const double step = tube.dynamics.step();
      EXPECT_LT(step, 1.02 * bound) << elements << " " << k;
      // On a cloud the zero-energy modes of a gas under pressure are held, too.
      EXPECT_GT(step, (elements ? 0.6 : 0.4) * bound) << elements << " " << k;
    }
  }
}

/// Copper of density 1 and sound speed 1 that hits a rigid wall.
constexpr MieGrueneisen copper{.density = 1.0, .sound_speed = 1.0, .slope = 1.489, .gamma = 1.99};

TEST(PlateImpact, MetalsAreOnTheirHugoniotBehindTheShock) {
  const auto state = EquationOfState::mie_grueneisen(copper);
  const double yield = 5e-3, mu = 0.35, speed = 0.15;
  const SharedMaterial metal =
      WithPressure(J2({.moduli = {.mu = mu, .kappa = 1.0}, .yield = yield, .strain = Strain::finite}), state);
  for (const SharedMaterial& material : {SharedMaterial(Fluid({.state = state})), metal}) {
    const bool solid = material->history_size() > 3;
    constexpr Index cells = 400;
    DeformableBody<2> body = ShockTube::strip(cells, material);
    body.velocity.row(0).setConstant(-speed);
    Dynamics<2> dynamics({body}, otm<2>(ShockTube::scheme_options()), ShockTube::dynamics_options());
    for (Index a = 0; a < body.nodes.cols(); ++a) dynamics.prescribe(a, 1, 0.0);
    for (const Index a : {Index(0), cells + 1}) dynamics.prescribe(a, 0, 0.0);
    const auto before = dynamics.balance();
    const double until = 0.5;
    dynamics.run(until);
    // U_s = c_0 + s u_p, p = rho_0 U_s u_p, e = u_p^2 / 2; of a solid the stress has 2/3 of the yield stress besides.
    const double Us = 1.0 + copper.slope * speed, J = 1.0 - speed / Us;
    const Tensors stress = dynamics.cauchy_stress(), F = dynamics.deformation();
    const Matrix history = dynamics.history(0);
    const Points<2> x = dynamics.points();
    double axial = 0.0, mean = 0.0, volume = 0.0, energy = 0.0;
    int behind = 0;
    for (Index p = 0; p < cells; ++p)
      if (x(0, p) > -0.5 + 0.3 * (Us - speed) * until && x(0, p) < -0.5 + 0.8 * (Us - speed) * until) {
        ++behind;
        axial -= stress(0, p);
        mean -= (stress(0, p) + stress(4, p) + stress(8, p)) / 3.0;
        volume += F(0, p) * F(4, p);
        energy += history(solid ? 8 : 1, p);
      }
    ASSERT_GT(behind, 80);
    axial /= behind;
    mean /= behind;
    volume /= behind;
    // Mass, momentum and energy across any shock, then where it is on the line of shocks.
    EXPECT_NEAR(axial, speed * speed / (1.0 - volume), 1e-3 * axial) << solid;
    EXPECT_NEAR(energy / behind, 0.5 * speed * speed, 5e-3 * 0.5 * speed * speed) << solid;
    EXPECT_NEAR(axial, Us * speed, solid ? 0.02 * axial : 5e-4 * axial) << solid;
    EXPECT_NEAR(volume, J, solid ? 2e-3 : 1e-4) << solid;
    EXPECT_NEAR(axial - mean, solid ? 2.0 / 3.0 * yield / J : 0.0, 0.03 * yield) << solid;
    const auto after = dynamics.balance();
    EXPECT_NEAR(after.total(), before.total(), 0.003 * before["kinetic"]) << solid;
    EXPECT_EQ(after["dissipated"] > 0.0, solid);
    EXPECT_GT(after["viscous"], 0.02 * before["kinetic"]);
  }
}

}  // namespace
}  // namespace efree
