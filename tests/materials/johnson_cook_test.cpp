// SPDX-License-Identifier: GPL-3.0-or-later
/// J2 with a yield stress that depends on the rate of strain and on temperature.
#include "efree/core/error.hpp"
#include "efree/materials/j2.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>

namespace efree {
namespace {

using ::testing::HasSubstr;
using testing::rotation, testing::Specimen;

// OFHC copper (Johnson & Cook 1983), in MPa, s, K.
constexpr double A = 90.0, B = 292.0, n = 0.31, C = 0.025, E = 124e3, nu = 0.34, mu = E / (2.0 * (1.0 + nu));
constexpr double capacity = 8960.0 * 383.0 * 1e-6;
const std::vector<int> across{4, 8};
const Heating hot{.capacity = capacity, .melting = 1356.0, .reference = 298.0, .exponent = 1.09};

J2Parameters copper(Strain strain = Strain::finite) {
  return {.moduli = {.E = E, .nu = nu},
          .yield = Hardening::ludwik(A, B, n),
          .strain = strain,
          .rate = RateFactor::johnson_cook(C, 1.0),
          .heating = hot};
}

TEST(RateFactor, IsTheLawThatWasAskedFor) {
  const RateFactor jc = RateFactor::johnson_cook(0.025, 2.0), cs = RateFactor::cowper_symonds(40.0, 5.0);
  EXPECT_DOUBLE_EQ(jc.at(200.0).value, 1.0 + 0.025 * std::log(100.0));
  EXPECT_EQ(jc.at(1.0).value, 1.0);
  EXPECT_EQ(jc.at(0.0).slope, 0.0);
  EXPECT_DOUBLE_EQ(cs.at(40.0).value, 2.0);
  EXPECT_DOUBLE_EQ(cs.at(1000.0).value, 1.0 + std::pow(25.0, 0.2));
  EXPECT_EQ(cs.at(0.0).value, 1.0);
  EXPECT_EQ(RateFactor().at(1e9).value, 1.0);
  EXPECT_TRUE(RateFactor().constant());
  const RateFactor table = RateFactor::table({0.1, 10.0, 1e4}, {0.9, 1.0, 1.6});
  EXPECT_EQ(table.at(0.0).value, 0.9);
  EXPECT_EQ(table.at(0.0).slope, 0.0);
  EXPECT_DOUBLE_EQ(table.at(1.0).value, 0.95) << "linear in the logarithm of the rate";
  EXPECT_DOUBLE_EQ(table.at(1e3).value, 1.4);
  EXPECT_EQ(table.at(1e9).value, 1.6);
  EXPECT_EQ(table.at(1e9).slope, 0.0);
  for (const RateFactor& one : {jc, cs, table})
    EXPECT_NEAR((one.at(300.0 + 1e-3).value - one.at(300.0 - 1e-3).value) / 2e-3, one.at(300.0).slope, 1e-9);
}

TEST(Heating, SoftensFromTheReferenceToTheMeltingTemperature) {
  EXPECT_EQ(hot.softening(-100.0).value, 1.0);
  EXPECT_EQ(hot.softening(0.0).value, 1.0);
  EXPECT_DOUBLE_EQ(hot.softening(529.0).value, 1.0 - std::pow(0.5, 1.09));
  EXPECT_NEAR((hot.softening(529.01).value - hot.softening(528.99).value) / 0.02, hot.softening(529.0).slope, 1e-9);
  EXPECT_EQ(hot.softening(1058.0).value, 0.0);
  EXPECT_EQ(hot.softening(5000.0).value, 0.0);
  Heating warm = hot;
  warm.initial = 398.0;
  EXPECT_DOUBLE_EQ(warm.softening(50.0).value, hot.softening(150.0).value);
}

/// Stress and temperature after tension at a constant rate of logarithmic strain, by a method of fourth order:
/// E (strain - a) = (A + B a^n) (1 + C ln a') (1 - T*^m), capacity T' = fraction * stress * a'.
std::pair<double, double> tension(const Heating& heating, double strain, double rate, int steps) {
  const Hardening yield = Hardening::ludwik(A, B, n);
  const auto slope = [&](double t, const Vec<2>& y) {
    const double stress = E * (rate * t - y[0]);
    const double still = yield.at(std::max(y[0], 0.0)).stress * heating.softening(y[1]).value;
    const double flow = stress > still ? std::exp((stress / still - 1.0) / C) : 0.0;
    return Vec<2>(flow, heating.fraction / heating.capacity * stress * flow);
  };
  Vec<2> y = Vec<2>::Zero();
  const double h = strain / rate / steps;
  for (int k = 0; k < steps; ++k) {
    const double t = k * h;
    const Vec<2> k1 = slope(t, y), k2 = slope(t + 0.5 * h, y + 0.5 * h * k1), k3 = slope(t + 0.5 * h, y + 0.5 * h * k2),
                 k4 = slope(t + h, y + h * k3);
    y += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  return {E * (strain - y[0]), y[1]};
}

TEST(JohnsonCook, TensionAtAConstantRateIsThatOfItsOrdinaryDifferentialEquation) {
  const double strain = 0.3;
  const J2 material(copper());
  for (const double rate : {50.0, 5000.0}) {
    const auto [stress, rise] = tension(hot, strain, rate, 400000);
    const auto [coarser, colder] = tension(hot, strain, rate, 200000);
    EXPECT_NEAR(stress / coarser, 1.0, 1e-9) << "it has stopped moving";
    EXPECT_NEAR(rise / colder, 1.0, 1e-9);
    EXPECT_GT(rise, 15.0);
    double before = 0.0;
    for (const int steps : {50, 100, 200}) {
      Specimen bar(material, across);
      bar.lasts(strain / rate / steps);
      for (int k = 1; k <= steps; ++k) bar.stretch_to(std::exp(strain * k / steps));
      const double error = std::abs(bar.kirchhoff()(0, 0) / stress - 1.0);
      EXPECT_LT(error, 2e-4) << rate << " " << steps;
      EXPECT_NEAR(bar.history()[7] / rise, 1.0, 2e-3) << rate << " " << steps;
      EXPECT_NEAR(bar.equivalent(), strain - bar.kirchhoff()(0, 0) / E, 1e-13);
      if (before > 0.0) {
        EXPECT_GT(before / error, 1.8) << rate << " " << steps << " " << error;
        EXPECT_LT(before / error, 4.5) << rate << " " << steps << " " << error;
      }
      before = error;
    }
  }
}

TEST(JohnsonCook, HeatOfPerfectFlowHasAClosedForm) {
  // dT* = f A (1 - T*) da / (c dT): the stress falls exponentially.
  Heating heating = hot;
  heating.exponent = 1.0;
  J2Parameters parameters{.moduli = {.E = E, .nu = nu}, .yield = A, .strain = Strain::finite, .heating = heating};
  const J2 material(parameters);
  const double fall = heating.fraction * A / (capacity * 1058.0);
  double before = 0.0;
  for (const int steps : {20, 40, 80}) {
    Specimen block(material);
    for (int k = 1; k <= steps; ++k) {
      const double e = 20.0 * k / steps;  // a very long way, in pure shear
      block.to(Vec<3>(std::exp(0.5 * e), std::exp(-0.5 * e), 1.0).asDiagonal());
    }
    const Mat<3> tau = block.kirchhoff();
    const double stress = std::sqrt(1.5) * (tau - tau.trace() / 3.0 * Mat<3>::Identity()).norm();
    const double error = std::abs(stress / (A * std::exp(-fall * block.equivalent())) - 1.0);
    EXPECT_LT(error, 1e-3) << steps;
    if (before > 0.0) {
      EXPECT_NEAR(before / error, 4.0, 0.6) << steps;
    }
    before = error;
  }
}

TEST(JohnsonCook, FlowFasterThanTheReferenceNeedsMoreStress) {
  // Steady shear of a metal that does not harden: Y (1 + C ln rate), and Y (1 + (rate / D)^(1/q)).
  const double rate = 300.0, dt = 1e-5;
  for (const auto& [factor, expected] : {std::pair{RateFactor::johnson_cook(C, 1.0), 1.0 + C * std::log(rate)},
                                         {RateFactor::cowper_symonds(40.4, 5.0), 1.0 + std::pow(rate / 40.4, 0.2)},
                                         {RateFactor::table({3.0, 3e4}, {0.8, 1.6}), 1.2},
                                         {RateFactor::table({1e3, 1e4}, {1.1, 1.6}), 1.1}}) {
    const J2 material({.moduli = {.E = E, .nu = nu}, .yield = A, .strain = Strain::finite, .rate = factor});
    EXPECT_FALSE(material.symmetric());
    Specimen bar(material, across);
    bar.lasts(dt);
    for (int k = 1; k <= 100; ++k) bar.stretch_to(std::exp(rate * dt * k));
    EXPECT_NEAR(bar.kirchhoff()(0, 0), A * expected, 1e-7 * A);
    bar.lasts(0.0);
    EXPECT_THAT([&] { bar.stretch_to(1.5); }, ::testing::ThrowsMessage<NumericalError>(HasSubstr("in no time")));
  }
}

/// At the end of a step the stress is the one of the tables at the plastic strain and its mean rate in the step,
/// across the kinks of both.
TEST(JohnsonCook, StressIsThatOfTheTablesAtThePlasticStrainAndItsRate) {
  const Hardening yield = Hardening::table({0.0, 0.02, 0.1, 0.3}, {A, 130.0, 170.0, 190.0});
  const RateFactor factor = RateFactor::table({1e-1, 10.0, 1e3}, {0.9, 1.0, 1.4});
  for (const Strain strain : {Strain::small, Strain::finite}) {
    const J2 material({.moduli = {.E = E, .nu = nu}, .yield = yield, .strain = strain, .rate = factor});
    Specimen block(material);
    double last = 0.0, sheared = 0.0;
    int flows = 0;
    for (int k = 1; k <= 200; ++k) {
      const double dt = 1e-4 * std::pow(10.0, k % 5);  // rates from 0.02 to 200
      block.lasts(dt);
      sheared += 4e-3;
      Mat<3> F = Mat<3>::Identity();
      F(0, 1) = sheared;
      block.to(F);
      const Mat<3> tau = strain == Strain::small ? block.P() : block.kirchhoff();
      const double stress = std::sqrt(1.5) * (tau - tau.trace() / 3.0 * Mat<3>::Identity()).norm();
      const double a = block.equivalent(), flow = a - std::exchange(last, a);
      if (flow == 0.0) continue;
      ++flows;
      EXPECT_NEAR(stress, yield.at(a).stress * factor.at(flow / dt).value, 1e-8 * stress) << k;
    }
    EXPECT_GT(flows, 100);
    EXPECT_GT(last, 0.3) << "beyond the table";
  }
}

TEST(JohnsonCook, PlasticWorkHeatsAndIsAllThatDoes) {
  for (const Strain strain : {Strain::small, Strain::finite}) {
    const J2 material(copper(strain));
    Specimen specimen(material);
    specimen.lasts(1e-4, 0.3);
    for (int k = 1; k <= 200; ++k)
      specimen.to(Mat<3>::Identity() +
                  0.05 * std::sin(0.05 * k) * Mat<3>{{1.0, 0.4, 0.0}, {0.2, -0.3, 0.5}, {0.0, 0.1, 0.6}});
    EXPECT_GT(specimen.dissipated, 10.0);
    EXPECT_NEAR(capacity * specimen.history()[7], 200 * 0.3 + 0.9 * specimen.dissipated, 1e-9);
    EXPECT_EQ(material.history_parts().back().name, "temperature_rise");
    EXPECT_EQ(material.history_parts().back().offset, 7);
  }
}

TEST(JohnsonCook, WorkIsWhatIsStoredAndWhatIsDissipated) {
  // To second order of the step.
  for (const bool fast : {false, true}) {
    J2Parameters parameters = copper();
    if (!fast) parameters.rate = RateFactor();
    parameters.yield = Hardening::linear(A, B);
    const J2 material(parameters);
    double first = 0.0;
    for (const int steps : {500, 16000}) {
      Specimen specimen(material);
      specimen.lasts(1e-3 / steps, 30.0 / steps);
      double work = 0.0;
      Mat<3> F = Mat<3>::Identity(), P = Mat<3>::Zero();
      for (int k = 1; k <= steps; ++k) {
        const Mat<3> next = Mat<3>::Identity() + 0.1 * std::sin(5.0 * k / steps) *
                                                     Mat<3>{{1.0, 0.4, 0.0}, {0.2, -0.3, 0.5}, {0.0, 0.1, 0.6}};
        specimen.to(next);
        work += 0.5 * (P + specimen.P()).cwiseProduct(next - F).sum();
        F = next;
        P = specimen.P();
      }
      const double error = std::abs(work / (specimen.response.energy[0] + specimen.dissipated) - 1.0);
      EXPECT_LT(error, 1e-4) << steps;
      // Where flow begins in a step is as it happens, so that ratios of near steps are uneven.
      if (steps == 500) {
        first = error;
      } else {
        EXPECT_NEAR(std::log(first / error) / std::log(32.0), 2.0, 0.3) << error;
      }
    }
  }
}

/// Points that flow at random, with a history.
Deformation flowing(const Material& material, Index points, double size) {
  std::srand(1);
  Deformation at = Deformation::none(Points<3>::Random(3, points), material.history_size());
  at.dt = 1e-4;
  for (int k = 0; k < 2; ++k) {
    at.F += size * Tensors::Random(9, points);
    if (k == 0) at.history = respond(material, at, false).history;
  }
  at.heat = Vector::Constant(points, 20.0);
  return at;
}

TEST(JohnsonCook, TangentsAreDerivatives) {
  for (const Strain strain : {Strain::small, Strain::finite})
    for (const bool heats : {false, true}) {
      J2Parameters parameters = copper(strain);
      if (!heats) parameters.heating.reset();
      for (const bool tables : {false, true}) {
        if (tables) {
          parameters.yield = Hardening::table({0.0, 0.01, 0.05, 2.0}, {A, 130.0, 180.0, 400.0});
          parameters.rate = RateFactor::table({1.0, 100.0, 1e5}, {0.9, 1.0, 1.5});
        }
        const J2 material(parameters);
        for (const double size : {0.005, 0.1})
          EXPECT_LT(testing::derivative_errors(material, flowing(material, 60, size), 1e-6).tangent, 1e-8)
              << heats << " " << size << " " << tables;
      }
    }
}

TEST(JohnsonCook, TurnsWithTheBodyAndIsTheSameWithATangent) {
  const J2 material(copper());
  const Mat<3> Q = rotation(2.0, {1.0, -0.4, 0.3});
  for (const double size : {0.01, 0.2}) {
    Deformation at = flowing(material, 50, size), turned = at;
    for (Index p = 0; p < at.size(); ++p) turned.F.col(p) = (Q * at.gradient(p)).reshaped();
    MaterialResponse a = respond(material, at, false), b = respond(material, turned, false),
                     c = respond(material, at, true);
    const double rises = std::max(10.0, a.history.row(7).maxCoeff());  // temperature is the largest number
    for (Index p = 0; p < at.size(); ++p)
      EXPECT_LT((b.stress(p) - Q * a.stress(p)).cwiseAbs().maxCoeff(), 1e-9) << size;
    EXPECT_LT((a.history - b.history).cwiseAbs().maxCoeff(), 1e-13 * rises) << size;
    EXPECT_LT((a.P - c.P).cwiseAbs().maxCoeff(), 1e-9) << size;
    EXPECT_LT((a.history - c.history).cwiseAbs().maxCoeff(), 1e-13 * rises) << size;
  }
}

TEST(JohnsonCook, WhatIsMeltedBearsNoShear) {
  const J2 material(copper());
  Deformation at = flowing(material, 20, 0.05);
  at.heat.setConstant(capacity * 1500.0);
  MaterialResponse response = respond(material, at, true);
  for (Index p = 0; p < at.size(); ++p) {
    const Mat<3> tau = response.stress(p) * at.gradient(p).transpose();
    EXPECT_LT((tau - tau.trace() / 3.0 * Mat<3>::Identity()).norm(), 1e-9);
  }
  EXPECT_LT(response.dissipated.cwiseAbs().maxCoeff(), 0.5 * A) << "the stress that is left at the step's start";
}

TEST(JohnsonCook, SofteningThatStartsWithoutBoundsIsNoTrouble) {
  // Armco iron (Johnson & Cook 1983): m = 0.55.
  const J2 iron(
      {.moduli = {.E = 207e3, .nu = 0.29},
       .yield = Hardening::ludwik(175.0, 380.0, 0.32),
       .strain = Strain::finite,
       .rate = RateFactor::johnson_cook(0.06, 1.0),
       .heating = Heating{.capacity = 7890.0 * 452.0 * 1e-6, .melting = 1811.0, .reference = 298.0, .exponent = 0.55}});
  Specimen bar(iron, across);
  bar.lasts(1e-5);
  double last = 0.0;
  for (int k = 1; k <= 400; ++k) {
    bar.stretch_to(std::exp(1e-3 * k));
    EXPECT_GT(bar.history()[7], last - 1e-12) << k;
    last = bar.history()[7];
  }
  const double rate = 100.0, cold = (175.0 + 380.0 * std::pow(bar.equivalent(), 0.32)) * (1.0 + 0.06 * std::log(rate));
  EXPECT_NEAR(bar.kirchhoff()(0, 0), cold * (1.0 - std::pow(last / 1513.0, 0.55)), 0.5);
}

TEST(JohnsonCook, PlaneStressPassesHeatOn) {
  const J2 material(copper());
  const PlaneStress sheet(material);
  Deformation at = Deformation::none(Points<3>::Zero(3, 2), sheet.history_size());
  at.F.col(1) = Vec<3>(1.01, 1.0, 1.0).asDiagonal().toDenseMatrix().reshaped();
  at.dt = 1e-3;
  at.heat = Vec<2>(5.0, 11.0);
  const MaterialResponse response = respond(sheet, at, false);
  for (const Index p : {0, 1})
    EXPECT_NEAR(capacity * response.history(7, p), at.heat[p] + 0.9 * response.dissipated[p], 1e-12);
  EXPECT_GT(response.dissipated[1], 0.0);
}

TEST(JohnsonCook, RefusesParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(HasSubstr(part)));
  };
  const auto with = [](auto member, double value) {
    return [=] {
      J2Parameters parameters = copper();
      (*parameters.heating).*member = value;
      J2{parameters};
    };
  };
  refuses(with(&Heating::capacity, 0.0), "heat capacity = 0");
  refuses(with(&Heating::melting, 298.0), "melting temperature = 298, expected more than the reference");
  refuses(with(&Heating::reference, std::nan("")), "reference temperature = nan");
  refuses(with(&Heating::exponent, 0.0), "exponent of thermal softening = 0");
  refuses(with(&Heating::fraction, 1.1), "fraction of plastic work that heats = 1.1");
  refuses([] { RateFactor::johnson_cook(-1.0, 1.0); }, "sensitivity C to the rate = -1");
  refuses([] { RateFactor::johnson_cook(0.1, 0.0); }, "reference rate = 0");
  refuses([] { RateFactor::cowper_symonds(0.0, 5.0); }, "rate D of Cowper and Symonds = 0");
  refuses([] { RateFactor::cowper_symonds(40.0, -5.0); }, "exponent q of Cowper and Symonds = -5");
  refuses([] { RateFactor::table({0.0, 1.0}, {1.0, 2.0}); }, "first rate of strain of a table = 0");
  refuses([] { RateFactor::table({2.0, 1.0}, {1.0, 2.0}); }, "rate of strain 1 of a table after 2");
  refuses([] { RateFactor::table({1.0, 2.0}, {1.0, 0.9}); }, "factor of a rate of strain = 0.9");
  refuses([] { RateFactor::table({1.0}, {1.0, 0.9}); }, "1 values of rate of strain and 2 of factor");
}

}  // namespace
}  // namespace efree
