// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/equation_of_state.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>
#include <functional>

namespace efree {
namespace {

using ::testing::HasSubstr;
using testing::rotation, testing::Specimen;
using State = EquationOfState::State;

constexpr double gas_gamma = 1.4, stiffening = 6.0, bulk = 2.2, exponent = 7.15;
constexpr MieGrueneisen copper_shock{.density = 8.93, .sound_speed = 3.94, .slope = 1.489, .gamma = 1.99};
const auto gas = EquationOfState::ideal_gas(gas_gamma), stiff_gas = EquationOfState::stiffened_gas(4.4, stiffening),
           water = EquationOfState::tait(bulk, exponent), metal = EquationOfState::mie_grueneisen(copper_shock);

struct NamedState {
  const char* name;
  EquationOfState state;
  double at_rest;  ///< pressure
};
std::vector<NamedState> equations_of_state() {
  return {{"ideal gas", gas, 1.5}, {"stiffened gas", stiff_gas, 0.2}, {"Tait", water, 0.1}, {"metal", metal, 0.3}};
}

/// To this J in as many steps.
EquationOfState::Step led(const NamedState& one, double J, int steps) {
  EquationOfState::Step step{};
  for (int k = 1; k <= steps; ++k) step = one.state.step(step.after, 1.0 + (J - 1.0) * k / steps, 0.0, one.at_rest);
  return step;
}

TEST(EquationOfState, IsTheLawThatWasAskedFor) {
  EXPECT_DOUBLE_EQ(gas.at(0.5, 3.0).pressure, 0.4 * 3.0 / 0.5);
  EXPECT_DOUBLE_EQ(stiff_gas.at(0.5, 30.0).pressure, 3.4 * 30.0 / 0.5 - 4.4 * stiffening);
  EXPECT_DOUBLE_EQ(water.at(0.9, 77.0).pressure, bulk / exponent * (std::pow(0.9, -exponent) - 1.0));
  const double eta = 0.1, K = copper_shock.density * copper_shock.sound_speed * copper_shock.sound_speed;
  EXPECT_DOUBLE_EQ(metal.at(0.9, 2.0).pressure,
                   K * eta / std::pow(1.0 - copper_shock.slope * eta, 2) * (1.0 - 0.5 * copper_shock.gamma * eta) +
                       copper_shock.gamma * 2.0);
  EXPECT_DOUBLE_EQ(metal.at(1.25, 2.0).pressure, -0.2 * K + copper_shock.gamma * 2.0);
}

TEST(EquationOfState, DerivativesAreThoseOfThePressure) {
  for (const NamedState& one : equations_of_state())
    for (const double J : {0.7, 0.95, 1.2})
      for (const double energy : {10.0, 25.0}) {
        const double h = 1e-5;
        const auto there = one.state.at(J, energy);
        const double by_J = (one.state.at(J + h, energy).pressure - one.state.at(J - h, energy).pressure) / (2.0 * h);
        const double by_energy =
            (one.state.at(J, energy + h).pressure - one.state.at(J, energy - h).pressure) / (2.0 * h);
        EXPECT_NEAR(there.by_J / by_J, 1.0, 2e-8) << one.name;
        EXPECT_NEAR(there.by_energy, by_energy, 1e-8) << one.name;
      }
  EXPECT_NEAR(metal.at(1.0 - 1e-9, 0.0).by_J, metal.at(1.0 + 1e-9, 0.0).by_J, 1e-5) << "no kink where it is at rest";
}

TEST(EquationOfState, SoundTravelsAsFastAsTheTextbooksSay) {
  const double J = 0.8, rho0 = 1.3, rho = rho0 / J, p = 0.7;
  EXPECT_NEAR(gas.sound_speed(J, p * J / 0.4, rho0), std::sqrt(gas_gamma * p / rho), 1e-14);
  EXPECT_NEAR(stiff_gas.sound_speed(J, (p + 4.4 * stiffening) * J / 3.4, rho0), std::sqrt(4.4 * (p + stiffening) / rho),
              1e-13);
  EXPECT_NEAR(water.sound_speed(1.0, 0.0, rho0), std::sqrt(bulk / rho0), 1e-15);
  EXPECT_NEAR(metal.sound_speed(1.0, 0.0, copper_shock.density), copper_shock.sound_speed, 1e-15);
  EXPECT_THROW(gas.sound_speed(1.0, -1.0, 1.0), NumericalError);
}

TEST(EquationOfState, StepsWithoutHeatFollowTheIsentropeToSecondOrder) {
  for (const NamedState& one : equations_of_state()) {
    // dE/dJ = -p, by a method of fourth order in steps that are short.
    const auto isentrope = [&](double J) {
      const double rest = one.state.energy_at_rest(one.at_rest),
                   offset = one.at_rest - one.state.at(1.0, rest).pressure;
      const auto slope = [&](double at, double energy) { return -one.state.at(at, energy).pressure - offset; };
      constexpr int steps = 2000;
      double energy = rest;
      const double h = (J - 1.0) / steps;
      for (int k = 0; k < steps; ++k) {
        const double at = 1.0 + k * h, k1 = slope(at, energy), k2 = slope(at + 0.5 * h, energy + 0.5 * h * k1),
                     k3 = slope(at + 0.5 * h, energy + 0.5 * h * k2), k4 = slope(at + h, energy + h * k3);
        energy += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
      }
      return std::pair(-slope(J, energy), energy - rest);
    };
    for (const double J : {0.7, 1.6}) {
      const auto [pressure, energy] = isentrope(J);
      if (one.name == std::string("ideal gas")) {
        EXPECT_NEAR(pressure, one.at_rest * std::pow(J, -gas_gamma), 1e-11);
      }
      if (one.name == std::string("stiffened gas")) {
        EXPECT_NEAR(pressure, (one.at_rest + stiffening) * std::pow(J, -4.4) - stiffening, 1e-10);
      }
      double before = 0.0;
      for (const int steps : {20, 40, 80}) {
        const auto there = led(one, J, steps);
        const double error = std::abs(there.after.energy - energy);
        EXPECT_EQ(there.after.heat, 0.0);
        EXPECT_LT(error, 4e-3 * std::abs(energy)) << one.name;
        if (before > 0.0) {
          EXPECT_NEAR(before / error, 4.0, 0.2) << one.name << " " << J << " " << steps;
        }
        before = error;
      }
    }
  }
}

TEST(EquationOfState, CompressionAndBackAgainIsNoLoss) {
  for (const NamedState& one : equations_of_state()) {
    EquationOfState::Step step = led(one, 0.75, 3);
    for (const double J : {1.0 - 0.5 / 3.0, 1.0 - 0.25 / 3.0, 1.0})
      step = one.state.step(step.after, J, 0.0, one.at_rest);
    EXPECT_NEAR(step.after.energy, 0.0, 1e-13) << one.name;
    EXPECT_NEAR(step.pressure, one.at_rest, 1e-12) << one.name;
  }
}

TEST(EquationOfState, OneStepAsLongAsAShockIsTheShock) {
  // Rankine and Hugoniot: of a perfect gas by the ratio of volumes, of a metal by U_s = c_0 + s u_p.
  for (const double J : {0.9, 0.5, 0.2}) {
    const double ratio = (2.4 - 0.4 * J) / (2.4 * J - 0.4);
    EXPECT_NEAR(gas.step({}, J, 0.0, 1.5).pressure / (1.5 * ratio), 1.0, 1e-13) << J;
  }
  for (const double J : {0.95, 0.8, 0.65}) {
    const auto shocked = metal.step({}, J, 0.0, 0.0);
    // 1 - J = u_p / U_s.
    const double up = (1.0 - J) * copper_shock.sound_speed / (1.0 - copper_shock.slope * (1.0 - J)),
                 Us = copper_shock.sound_speed + copper_shock.slope * up;
    EXPECT_NEAR(shocked.pressure / (copper_shock.density * Us * up), 1.0, 1e-13) << J;
    EXPECT_NEAR(shocked.after.energy / (0.5 * copper_shock.density * up * up), 1.0, 1e-13) << J;
  }
}

TEST(EquationOfState, HeatPressesWhereTheLawSaysSo) {
  const State before{-0.2, 0.3, 0.1};
  for (const NamedState& one : equations_of_state()) {
    const auto cold = one.state.step(before, 0.8, 0.0, one.at_rest),
               warm = one.state.step(before, 0.8, 0.7, one.at_rest);
    EXPECT_NEAR(warm.pressure - cold.pressure, 0.7 * one.state.at(0.8, 0.0).by_energy, 1e-13) << one.name;
    EXPECT_NEAR(warm.after.energy, 1.0, 1e-14) << one.name;
    EXPECT_DOUBLE_EQ(warm.after.heat, 0.8) << one.name;
  }
}

TEST(EquationOfState, WhatNoShockMakesIsAnError) {
  const auto fails = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<NumericalError>(HasSubstr(part)));
  };
  fails([] { gas.step({}, 0.16, 0.0, 1.0); }, "compressed from J = 1 to 0.16 in one step");
  fails([] { gas.step({}, 7.0, 0.0, 1.0); }, "expanded from J = 1 to 7 in one step");
  fails([] { metal.at(0.3, 0.0); }, "compressed to J = 0.3: no shock leads beyond 1 - 1 / s = 0.328");
  fails([] { gas.at(0.0, 1.0); }, "J = 0");
  const Fluid fluid({.state = gas, .pressure = 1.0});
  Deformation at = testing::deformed(fluid, 0.5 * Mat<3>::Identity());
  at.X.col(0) << 0.5, -1.0, 2.0;
  fails([&] { respond(fluid, at, false); }, "in one step, further than any shock does at (0.5, -1, 2)");
  at.F(0, 0) = -1.0;
  fails([&] { respond(fluid, at, false); }, "turned inside out");
}

/// Materials of these laws, with a step in which viscous ones flow.
struct Body {
  const char* name;
  SharedMaterial material;
  double dt;
};
const ElasticModuli moduli{.mu = 5.0, .kappa = 12.0};
const J2Parameters hardening{.moduli = moduli, .yield = Hardening::linear(0.2, 0.5), .strain = Strain::finite};
J2Parameters heated() {
  J2Parameters result = hardening;
  result.heating = Heating{.capacity = 2.0, .melting = 1.0, .fraction = 0.8};
  return result;
}
std::vector<Body> bodies() {
  return {{"gas", Fluid({.state = gas, .pressure = 1.5}), 0.1},
          {"water", Fluid({.state = water}), 0.1},
          {"metal", Fluid({.state = metal}), 0.1},
          {"viscous", Fluid({.state = gas, .pressure = 1.5, .viscosity = 0.2, .bulk_viscosity = 0.3}), 0.1},
          {"J2", WithPressure(J2(hardening), metal), 0.1},
          {"hot J2", WithPressure(J2(heated()), metal), 0.1},
          {"J2 that heat does not press", WithPressure(J2(hardening), water), 0.1},
          {"rubber", WithPressure(NeoHookeanSplit(moduli), water), 0.1}};
}

/// Once around in as many steps, a unit of time, with a lasting shear; turned ever further if asked to.
Mat<3> around(double s, double turns = 0.0) {
  Mat<3> shape;
  shape << 1.0, 0.4, 0.0, 0.2, -0.3, 0.5, 0.0, 0.1, 0.6;
  const double angle = 2.0 * 3.14159265358979 * s;
  const Mat<3> F = Mat<3>::Identity() + 0.12 * (std::sin(angle) * shape + (1.0 - std::cos(angle)) * shape.transpose());
  return rotation(turns * s, {1.0, -0.4, 0.3}) * F;
}

TEST(EquationOfState, TheWorkOfStressIsWhatIsStoredAndWhatIsDissipated) {
  for (const Body& body : bodies()) {
    const bool viscous = body.name == std::string("viscous"), flows = body.name[0] == 'J' || body.name[0] == 'h';
    double before = 0.0, first = 0.0;
    for (const int steps : {500, 1000, 2000}) {
      Specimen specimen(*body.material);
      specimen.lasts(1.0 / steps, 0.4 / steps);  // heat that comes is nobody's work
      specimen.to(Mat<3>::Identity());
      double work = 0.0, largest = 0.0;
      Mat<3> F = Mat<3>::Identity(), P = specimen.P();
      const double start = specimen.response.energy[0];
      for (int k = 1; k <= steps; ++k) {
        const Mat<3> next = around(0.8 * k / steps);
        specimen.to(next);
        work +=
            viscous ? specimen.P().cwiseProduct(next - F).sum() : 0.5 * (P + specimen.P()).cwiseProduct(next - F).sum();
        F = next;
        P = specimen.P();
        largest = std::max(largest, std::abs(specimen.response.energy[0]));
      }
      const double error = std::abs(work - (specimen.response.energy[0] - start) - specimen.dissipated);
      EXPECT_LT(error, viscous ? 6e-3 * largest : 2e-4 * largest) << body.name;
      EXPECT_EQ(specimen.dissipated > 0.0, viscous || flows) << body.name;
      // Viscous stress is that of the step's mean rate, at its end; where flow begins in a step is as it happens.
      if (steps == 500) first = error;
      if (before > 0.0 && !flows) {
        EXPECT_GT(before / error, viscous ? 1.8 : 3.8) << body.name << " " << steps;
        EXPECT_LT(before / error, viscous ? 2.2 : 4.2) << body.name << " " << steps;
      }
      if (steps == 2000 && flows) {
        EXPECT_GT(first / error, 10.0) << body.name;
        EXPECT_LT(first / error, 40.0) << body.name;
      }
      before = error;
    }
  }
}

TEST(EquationOfState, InternalEnergyIsWorkAndAllHeat) {
  for (const Body& body : bodies()) {
    Specimen specimen(*body.material);
    specimen.lasts(0.01, 0.004);
    for (int k = 1; k <= 80; ++k) specimen.to(around(0.01 * k));
    const auto parts = body.material->history_parts();
    const auto value = [&](const char* name) {
      for (const auto& part : parts)
        if (part.name == name) return specimen.history()[part.offset];
      return std::nan("");
    };
    EXPECT_NEAR(value("heat"), 80 * 0.004 + specimen.dissipated, 1e-13) << body.name;
    EXPECT_NEAR(value("dilatation"), specimen.F().determinant() - 1.0, 1e-14) << body.name;
    if (body.name[0] == 'h') {
      EXPECT_NEAR(2.0 * value("temperature_rise"), 80 * 0.004 + 0.8 * specimen.dissipated, 1e-13);
    }
    if (dynamic_cast<const Fluid*>(&*body.material) != nullptr) {
      EXPECT_NEAR(specimen.response.energy[0], value("internal_energy") - value("heat"), 1e-13) << body.name;
    }
  }
}

TEST(EquationOfState, StressesTurnWithTheBodyAndTurnsHeatNothing) {
  for (const Body& body : bodies()) {
    Specimen still(*body.material), turned(*body.material);
    still.lasts(0.02);
    turned.lasts(0.02);
    for (int k = 1; k <= 40; ++k) {
      const Mat<3> Q = around(0.02 * k, 9.0) * around(0.02 * k).inverse();
      still.to(around(0.02 * k));
      turned.to(around(0.02 * k, 9.0));
      EXPECT_LT((turned.P() - Q * still.P()).cwiseAbs().maxCoeff(), 2e-12) << body.name << " " << k;
      EXPECT_NEAR(turned.response.energy[0], still.response.energy[0], 1e-12) << body.name;
      EXPECT_NEAR(turned.dissipated, still.dissipated, 1e-13) << body.name;
    }
  }
}

TEST(EquationOfState, TangentsAreDerivativesOfTheStep) {
  for (const Body& body : bodies()) {
    std::srand(1);
    Deformation at = Deformation::none(Points<3>::Random(3, 40), body.material->history_size());
    at.dt = body.dt;
    at.F += 0.1 * Tensors::Random(9, 40);
    at.history = respond(*body.material, at, false).history;
    at.heat = Vector::Constant(40, 0.05);
    const bool viscous = body.name == std::string("viscous");
    const bool heats = body.name == std::string("J2") || body.name == std::string("hot J2");
    at.F += (viscous ? 1e-6 : 0.05) * Tensors::Random(9, 40);
    EXPECT_LT(testing::derivative_errors(*body.material, at, 2e-6).tangent, viscous ? 2e-6
                                                                            : heats ? 5e-3
                                                                                    : 3e-9)
        << body.name;
  }
}

TEST(Fluid, ViscousStressIsOfTheRateOfStrain) {
  const double mu = 0.2, zeta = 0.3, dt = 0.01, rate = 3.0;
  const Fluid fluid({.state = water, .viscosity = mu, .bulk_viscosity = zeta});
  Specimen sheared(fluid);
  sheared.lasts(dt);
  Mat<3> F = Mat<3>::Identity();
  for (int k = 1; k <= 50; ++k) {
    F(0, 1) = k * rate * dt;
    sheared.to(F);
  }
  EXPECT_NEAR(sheared.kirchhoff()(0, 1), mu * rate, mu * rate * rate * rate * dt * dt) << "second order in the step";
  EXPECT_GT(std::abs(sheared.kirchhoff()(0, 1) - mu * rate), 1e-7);
  EXPECT_NEAR(sheared.dissipated / (50 * dt), mu * rate * rate, 1e-3);
  Specimen swelling(fluid);
  swelling.lasts(dt);
  for (int k = 1; k <= 5; ++k) swelling.to(std::exp(k * rate * dt / 3.0) * Mat<3>::Identity());
  const double J = std::exp(5 * rate * dt);
  EXPECT_NEAR(swelling.kirchhoff()(0, 0) / J, zeta * rate - water.at(J, 0.0).pressure, 1e-13);
  Specimen stretched(fluid);
  stretched.lasts(dt);
  for (int k = 1; k <= 80; ++k)
    stretched.to(Vec<3>(std::exp(k * rate * dt), std::exp(-k * rate * dt), 1.0).asDiagonal());
  EXPECT_NEAR(stretched.kirchhoff()(0, 0), 2.0 * mu * rate, 1e-12);
  EXPECT_NEAR(stretched.dissipated, 80 * dt * 4.0 * mu * rate * rate, 1e-11);
  stretched.to(stretched.F());
  EXPECT_LT(stretched.P().cwiseAbs().maxCoeff(), 1e-12) << "at rest a fluid bears no shear";
  stretched.lasts(0.0);
  EXPECT_THAT([&] { stretched.to(1.1 * stretched.F()); },
              ::testing::ThrowsMessage<NumericalError>(HasSubstr("flows in no time at (0, 0, 0)")));
}

TEST(Fluid, IsAtItsPressureWhereNothingHasHappenedAndThatOfThePlace) {
  for (const NamedState& one : equations_of_state()) {
    const Fluid fluid(
        {.state = one.state, .pressure = [&](const Vec<3>& X) { return one.at_rest * (1.0 + X[0] * X[0]); }});
    EXPECT_FALSE(fluid.homogeneous());
    Deformation at = Deformation::none(Points<3>::Random(3, 5), 3);
    MaterialResponse response = respond(fluid, at, false);
    for (Index p = 0; p < 5; ++p) {
      const double pressure = one.at_rest * (1.0 + at.X(0, p) * at.X(0, p));
      EXPECT_LT((response.stress(p) + pressure * Mat<3>::Identity()).cwiseAbs().maxCoeff(), 1e-13) << one.name;
    }
    EXPECT_EQ(response.energy.cwiseAbs().maxCoeff() + response.history.cwiseAbs().maxCoeff(), 0.0) << one.name;
  }
}

TEST(WithPressure, KeepsTheDeviatorAndTakesThePressure) {
  const J2 metal_alone(hardening);
  const WithPressure both(J2(hardening), metal);
  Specimen one(both);
  for (int k = 1; k <= 20; ++k) one.to(around(0.04 * k));
  const double J = one.F().determinant();
  const Mat<3> tau = one.kirchhoff();
  EXPECT_NEAR(-tau.trace() / 3.0 / J, metal.at(J, one.history()[8]).pressure, 1e-12);
  EXPECT_NEAR(std::sqrt(1.5) * (tau - tau.trace() / 3.0 * Mat<3>::Identity()).norm(), 0.2 + 0.5 * one.equivalent(),
              1e-12);
  EXPECT_GT(one.history()[9], 0.0) << "plastic work heats";
  Deformation shape = Deformation::none(Points<3>::Zero(3, 1), 7);
  Specimen alone(metal_alone);
  for (int k = 1; k <= 20; ++k) alone.to(around(0.04 * k) / std::cbrt(around(0.04 * k).determinant()));
  EXPECT_LT((alone.history() - one.history().head<7>()).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_THAT(both.history_parts()[2].name, "dilatation");
  EXPECT_EQ(both.history_parts()[2].offset, 7);
}

TEST(EquationOfState, RefusesParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(HasSubstr(part)));
  };
  refuses([] { EquationOfState::ideal_gas(1.0); }, "ratio gamma of specific heats = 1");
  refuses([] { EquationOfState::stiffened_gas(4.4, -1.0); }, "stiffening pressure = -1");
  refuses([] { EquationOfState::tait(0.0, 7.0); }, "bulk modulus = 0");
  refuses([] { EquationOfState::tait(1.0, std::nan("")); }, "Tait's exponent = nan");
  refuses([] { EquationOfState::mie_grueneisen({.density = 1.0}); }, "sound speed = 0");
  refuses([] { EquationOfState::mie_grueneisen({1.0, 1.0, -1.0, 2.0}); }, "slope s of the shock velocity = -1");
  refuses([] { EquationOfState::mie_grueneisen({1.0, 1.0, 1.0, -2.0}); }, "Grueneisen's gamma = -2");
  refuses([] { Fluid({.state = gas, .viscosity = -1.0}); }, "viscosity = -1");
  refuses([] { Fluid({.state = gas, .pressure = std::nan("")}); }, "pressure = nan");
  refuses([] { WithPressure(J2({.moduli = moduli, .yield = 1.0}), gas); }, "finite strains expected");
}

}  // namespace
}  // namespace efree
