// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/j2.hpp"

#include "efree/core/error.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>

namespace efree {
namespace {

using testing::Specimen;

constexpr double E = 210e3, nu = 0.29, mu = E / (2.0 * (1.0 + nu)), yield = 450.0, H = 1300.0;
const ElasticModuli steel{.E = E, .nu = nu};
const std::vector<int> across{4, 8};  // F_yy and F_zz: free in uniaxial tension

std::vector<Hardening> hardenings() {
  return {yield,
          Hardening::linear(yield, H),
          Hardening::power_law(yield, yield / E, 0.15),
          Hardening::voce(yield, 715.0, 16.93, 129.24),
          Hardening::table({0.0, 0.01, 0.05}, {yield, 520.0, 560.0}),
          Hardening([](double a) { return yield + 300.0 * std::sqrt(a + 0.01) - 30.0; },
                    [](double a) { return 150.0 / std::sqrt(a + 0.01); })};
}

/// From zero, in parts over which Gauss's rule is exact.
double work(const Hardening& hardening, double a) {
  double sum = 0.0;
  for (int k = 0; k < 200; ++k) sum += hardening.work(a * k / 200.0, a * (k + 1) / 200.0);
  return sum;
}

TEST(J2, UniaxialTensionFollowsTheYieldStressWhateverTheSteps) {
  for (const Hardening& hardening : hardenings()) {
    const J2 material({.moduli = steel, .yield = hardening});
    for (const int steps : {1, 7}) {
      Specimen bar(material, across);
      for (int k = 1; k <= steps; ++k) bar.stretch_to(1.0 + 0.03 * k / steps);
      const double sigma = bar.P()(0, 0), a = 0.03 - sigma / E;
      EXPECT_NEAR(bar.equivalent(), a, 1e-14);
      EXPECT_NEAR(sigma, hardening.at(a).stress, 1e-9);
      EXPECT_NEAR(bar.F()(1, 1) - 1.0, -nu * sigma / E - 0.5 * a, 1e-14) << "plastic strain keeps the volume";
      EXPECT_NEAR(bar.dissipated, work(hardening, a), steps == 1 ? 1e-5 : 1e-9) << "one step: Gauss's rule";
      EXPECT_NEAR(bar.response.energy[0], 0.5 * sigma * sigma / E, 1e-12);
    }
  }
}

TEST(J2, FlowsHoweverLittleWhereHardeningBeginsWithoutBoundAndItsSlopeIsADifference) {
  // As of an expression: what is flowed at first is far less than the difference is over.
  const auto stress = [](double a) { return 120.0 + 400.0 * std::pow(a, 0.4); };
  const auto slope = [stress](double a) { return (stress(a + 6e-9) - stress(a)) / 6e-9; };
  const J2 material({.moduli = steel, .yield = Hardening(stress, slope)});
  for (double excess = 1e-13; excess < 1.0; excess *= 1.1) {
    Specimen block(material);
    Mat<3> F = Mat<3>::Identity();
    F(0, 1) = 120.0 / (std::sqrt(3.0) * mu) * (1.0 + excess);
    block.to(F);
    ASSERT_NEAR(std::sqrt(3.0) * block.P()(0, 1), stress(block.equivalent()), 1e-11) << excess;
  }
}

TEST(J2, LinearHardeningHasTheElastoplasticModulus) {
  const J2 material({.moduli = steel, .yield = Hardening::linear(yield, H)});
  Specimen loaded(material, across);
  loaded.stretch_to(1.01);
  const double first = loaded.P()(0, 0);
  loaded.stretch_to(1.02);
  EXPECT_NEAR((loaded.P()(0, 0) - first) / 0.01, E * H / (E + H), 1e-7);
  loaded.stretch_to(1.0195);
  EXPECT_NEAR(loaded.P()(0, 0), first + 0.01 * E * H / (E + H) - 0.0005 * E, 1e-9) << "unloads elastically";
}

TEST(J2, SimpleShearYieldsAtTheYieldStressOverTheRootOfThree) {
  for (const Hardening& hardening : hardenings()) {
    const J2 material({.moduli = steel, .yield = hardening});
    Specimen block(material);
    Mat<3> F = Mat<3>::Identity();
    for (const double gamma : {0.004, 0.03, 0.05}) {
      F(0, 1) = gamma;
      block.to(F);
    }
    const double tau = block.P()(0, 1);
    EXPECT_NEAR(block.equivalent(), (0.05 - tau / mu) / std::sqrt(3.0), 1e-15);
    EXPECT_NEAR(tau, hardening.at(block.equivalent()).stress / std::sqrt(3.0), 1e-10);
    EXPECT_LT(std::abs(block.P()(0, 0)) + std::abs(block.P()(2, 2)), 1e-9);
  }
}

TEST(J2, EquibiaxialTensionOfASheetFollowsTheYieldStress) {
  for (const Hardening& hardening : hardenings()) {
    const PlaneStress sheet{J2({.moduli = steel, .yield = hardening})};
    Specimen one(sheet);
    for (const double strain : {0.001, 0.012, 0.02}) one.to(Vec<3>(1.0 + strain, 1.0 + strain, 1.0).asDiagonal());
    const double sigma = one.P()(0, 0), a = 2.0 * (0.02 - (1.0 - nu) / E * sigma);
    EXPECT_NEAR(one.equivalent(), a, 1e-13);
    EXPECT_NEAR(sigma, hardening.at(a).stress, 1e-9);
    EXPECT_NEAR(one.P()(1, 1), sigma, 1e-9);
  }
}

TEST(J2, KinematicHardeningClosesItsLoopsAndKeepsTheElasticRange) {
  const double Hk = 5000.0, Et = E * Hk / (E + Hk), strain = 0.01;
  const J2 material({.moduli = steel, .yield = yield, .kinematic = Hk});
  Specimen bar(material, across);
  std::vector<double> peaks;
  std::vector<Vector> states;
  for (int cycle = 0; cycle < 3; ++cycle)
    for (const double end : {strain, -strain}) {
      const double start = bar.F()(0, 0) - 1.0;
      for (int k = 1; k <= 5; ++k) bar.stretch_to(1.0 + start + (end - start) * k / 5.0);
      peaks.push_back(bar.P()(0, 0));
      states.push_back(bar.history().head<6>());
    }
  const double first = yield + Et * (strain - yield / E);
  EXPECT_NEAR(peaks[0], first, 1e-9);
  // Back over the elastic range of twice the yield stress, then along the same slope.
  EXPECT_NEAR(peaks[1], first - 2.0 * yield - Et * (2.0 * strain - 2.0 * yield / E), 1e-9);
  for (int k = 2; k < 6; ++k) {
    EXPECT_NEAR(peaks[k], peaks[k - 2], 1e-9) << k;
    EXPECT_LT((states[k] - states[k - 2]).cwiseAbs().maxCoeff(), 1e-15) << k;
  }
  // The loop's area: yield stress times plastic path. The back stress gives back what it stored.
  const double path = bar.equivalent();
  EXPECT_NEAR(bar.dissipated, yield * path, 1e-9);
  const double plastic = -strain - peaks[5] / E;
  EXPECT_NEAR(bar.response.energy[0], 0.5 * peaks[5] * peaks[5] / E + 0.5 * Hk * plastic * plastic, 1e-10);
}

TEST(J2, IsotropicHardeningWidensTheElasticRangeOnReversal) {
  const J2 material({.moduli = steel, .yield = Hardening::linear(yield, H)});
  Specimen bar(material, across);
  bar.stretch_to(1.02);
  const double there = bar.P()(0, 0);
  bar.stretch_to(1.02 - 2.0 * there / E + 1e-9);
  EXPECT_NEAR(bar.P()(0, 0), -there, 3e-4);
  const double before = bar.equivalent();
  bar.stretch_to(1.0);
  EXPECT_GT(bar.equivalent(), before);
  EXPECT_NEAR(bar.P()(0, 0), -(yield + H * bar.equivalent()), 1e-9);
}

TEST(J2, FiniteTensionFollowsTheYieldStressInLogarithmicStrain) {
  for (const Hardening& hardening : hardenings())
    for (const int steps : {1, 20}) {
      const J2 material({.moduli = steel, .yield = hardening, .strain = Strain::finite});
      Specimen bar(material, across);
      // Newton's method for the width wants more than one step when the bar doubles its length.
      const double end = steps == 1 ? 1.02 : 2.0;
      for (int k = 1; k <= steps; ++k) bar.stretch_to(std::pow(end, static_cast<double>(k) / steps));
      const double tau = bar.kirchhoff()(0, 0), a = std::log(end) - tau / E;
      EXPECT_NEAR(bar.equivalent(), a, 1e-13);
      EXPECT_NEAR(tau, hardening.at(a).stress, 1e-8);
      EXPECT_NEAR(std::log(bar.F().determinant()), (1.0 - 2.0 * nu) * tau / E, 1e-13) << "volume is elastic";
      EXPECT_NEAR(bar.dissipated, work(hardening, a), 1e-5) << "of the function by Gauss's rule";
      Mat<3> metric = Mat<3>::Identity();
      metric.diagonal() += bar.history().head<3>();
      EXPECT_NEAR(metric.determinant(), 1.0, 1e-13);
      EXPECT_NEAR(metric(0, 0), std::exp(-2.0 * a), 1e-14);
    }
}

TEST(J2, FiniteShearDoesNotOscillateAndTurningTheBodyIsNoWork) {
  const J2 material({.moduli = steel, .yield = yield, .strain = Strain::finite});
  Specimen block(material);
  Mat<3> F = Mat<3>::Identity();
  for (int k = 1; k <= 100; ++k) {
    F(0, 1) = 0.05 * k;
    block.to(F);
    const Mat<3> tau = block.kirchhoff(), s = tau - tau.trace() / 3.0 * Mat<3>::Identity();
    EXPECT_NEAR(std::sqrt(1.5) * s.norm(), yield, 1e-9);
    if (k > 10) {
      EXPECT_NEAR(tau(0, 1), yield / std::sqrt(3.0), 0.002 * yield) << k;
    }
  }
  const double before = block.dissipated;
  for (int k = 1; k <= 20; ++k) block.to(testing::rotation(0.3 * k, {1.0, 0.3, -0.2}) * F);
  EXPECT_LT(block.dissipated - before, 1e-9 * before) << "but for rounding";
}

TEST(J2, FieldsAreThoseOfThePlace) {
  const auto field = [](const Vec<3>& X) { return E * (1.0 + X.squaredNorm()); };
  const J2 graded({.moduli = {.E = field, .nu = nu}, .yield = yield});
  EXPECT_FALSE(graded.homogeneous());
  const auto at = testing::random_deformation(graded, 5, 0.01);
  const auto found = respond(graded, at, false);
  for (Index p = 0; p < at.size(); ++p) {
    const Deformation one{at.X.col(p), at.F.col(p), at.history.col(p)};
    EXPECT_EQ(found.P.col(p),
              respond(J2({.moduli = {.E = field(at.X.col(p)), .nu = nu}, .yield = yield}), one, false).P);
  }
}

TEST(J2, RefusesParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses([] { J2({.moduli = {.E = 1.0}, .yield = 1.0}); }, "E given, expected two");
  refuses([] { J2({.moduli = steel, .yield = -1.0}); }, "yield stress = -1");
  refuses([] { J2({.moduli = steel, .yield = 1.0, .kinematic = -2.0}); }, "kinematic hardening modulus -2");
  refuses([] { J2({.moduli = steel, .yield = 1.0, .kinematic = 2.0, .strain = Strain::finite}); }, "small strains");
}

}  // namespace
}  // namespace efree
