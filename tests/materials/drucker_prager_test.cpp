// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/drucker_prager.hpp"

#include "efree/core/error.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>
#include <random>

namespace efree {
namespace {

using testing::Specimen;

constexpr double E = 100.0, nu = 0.25, c = 0.2;
const double friction = 0.5, sine = std::sin(friction), cosine = std::cos(friction);
const ElasticModuli moduli{.E = E, .nu = nu};
const std::vector<ConeFit> fits{ConeFit::compression, ConeFit::extension, ConeFit::plane_strain};

DruckerPrager soil(ConeFit fit, std::optional<double> dilatancy = {}, Strain strain = Strain::small) {
  return DruckerPrager(
      {.moduli = moduli, .cohesion = c, .friction = friction, .dilatancy = dilatancy, .fit = fit, .strain = strain});
}

TEST(DruckerPrager, HasTheStrengthOfMohrAndCoulombWhereItIsFitted) {
  for (const Strain strain : {Strain::small, Strain::finite})
    for (const double dilatancy : {0.0, 0.2, friction}) {
      const DruckerPrager outer = soil(ConeFit::compression, dilatancy, strain),
                          inner = soil(ConeFit::extension, dilatancy, strain);
      Specimen pressed(outer, {4, 8}), pulled(inner, {4, 8});
      for (int k = 1; k <= 10; ++k) {
        pressed.stretch_to(1.0 - 0.003 * k);
        pulled.stretch_to(1.0 + 0.003 * k);
      }
      EXPECT_NEAR(pressed.kirchhoff()(0, 0) / (strain == Strain::small ? pressed.F()(0, 0) : 1.0),
                  -2.0 * c * cosine / (1.0 - sine), 1e-12)
          << "uniaxial compression";
      EXPECT_NEAR(pulled.kirchhoff()(0, 0) / (strain == Strain::small ? pulled.F()(0, 0) : 1.0),
                  2.0 * c * cosine / (1.0 + sine), 1e-12)
          << "uniaxial tension";
    }
}

TEST(DruckerPrager, HasTheLimitLoadOfMohrAndCoulombInPlaneStrain) {
  // Pressed along x, free along y, held along z, until only plastic strains grow.
  const DruckerPrager rock = soil(ConeFit::plane_strain);
  Specimen block(rock, {4});
  for (int k = 1; k <= 60; ++k) block.stretch_to(1.0 - 0.01 * k);
  EXPECT_NEAR(block.P()(0, 0), -2.0 * c * cosine / (1.0 - sine), 1e-9);
}

TEST(DruckerPrager, TensionFromAllSidesEndsAtTheApex) {
  for (const ConeFit fit : fits)
    for (const double dilatancy : {0.0, 0.3, friction}) {
      const DruckerPrager rock = soil(fit, dilatancy);
      const double apex = c / std::tan(friction);
      Specimen one(rock);
      Mat<3> F = Mat<3>::Identity();
      for (const double strain : {0.001, 0.01, 0.05}) {
        F = (1.0 + strain) * Mat<3>::Identity();
        F(0, 1) = 0.1 * strain;
        one.to(F);
      }
      EXPECT_LT((one.P() - apex * Mat<3>::Identity()).cwiseAbs().maxCoeff(), 1e-14);
      EXPECT_LT(one.response.A.cwiseAbs().maxCoeff(), 1e-12) << "no stiffness is left";
    }
}

TEST(DruckerPrager, StressesReachTheApexContinuouslyFromTheCone) {
  // With hardening, associated or not: along a path from the cone over its tip stress and history have no jump.
  for (const double dilatancy : {0.0, 0.2, friction}) {
    const DruckerPrager rock(
        {.moduli = moduli, .cohesion = Hardening::linear(c, 5.0), .friction = friction, .dilatancy = dilatancy});
    double largest = 0.0;
    Vector before;
    constexpr int steps = 4000;
    for (int k = 0; k <= steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      Mat<3> F = (1.0 + 0.02 * t) * Mat<3>::Identity();
      F(0, 1) = 0.03 * (1.0 - t);
      auto response = respond(rock, testing::deformed(rock, F), false);
      Vector now(16);
      now << response.P.col(0), response.history.col(0);
      if (k > 0) largest = std::max(largest, (now - before).cwiseAbs().maxCoeff());
      before = now;
    }
    EXPECT_LT(largest, 1.5e-3) << "steps of 5e-6 in strains, stiffness 200: " << dilatancy;
    EXPECT_GT(before[9], 0.0);
  }
}

TEST(DruckerPrager, GapsBetweenGrainsCloseBeforeThereIsStressAgain) {
  // Sand is pressed, torn apart and sheared, and pressed together again: its stress is back where its volume is, not
  // before. With cohesion there are no gaps, and it is stiff at once.
  for (const Strain strain : {Strain::small, Strain::finite})
    for (const auto& [cohesion, dilatancy] : {std::pair(0.0, 0.0), std::pair(0.0, 0.3), std::pair(c, 0.0)}) {
      DruckerPragerParameters sand{.moduli = moduli, .cohesion = Hardening(cohesion), .friction = friction};
      sand.dilatancy = dilatancy;
      sand.strain = strain;
      const DruckerPrager material(sand);
      Specimen one(material);
      const auto press = [&](double volume, double shear) {
        Mat<3> F = strain == Strain::finite ? std::exp(volume / 3.0) * Mat<3>::Identity()
                                            : Mat<3>((1.0 + volume / 3.0) * Mat<3>::Identity());
        F(0, 1) = shear;
        one.to(F);
        return one.P()(0, 0);
      };
      const double pressed = press(-0.003, 0.0);
      EXPECT_LT(pressed, 0.0);
      for (const double shear : {0.0, 0.1, 0.0}) press(0.12, shear);
      if (cohesion == 0.0) {
        EXPECT_LT(one.P().norm(), 1e-14);
        EXPECT_NEAR(one.history()[7], 0.12, strain == Strain::finite ? 0.02 : 1e-12);
      } else {
        EXPECT_GT(one.P()(0, 0), 0.0);
        EXPECT_EQ(one.history()[7], 0.0);
      }
      const double ajar = press(0.003, 0.0);
      if (cohesion == 0.0)
        EXPECT_LT(one.P().norm(), 1e-14) << "still open";
      else
        EXPECT_LT(ajar, pressed);
      if (cohesion > 0.0) continue;
      EXPECT_NEAR(press(-0.003, 0.0), pressed, 1e-12 * std::abs(pressed));
      EXPECT_NEAR(one.history()[7], 0.0, 1e-15);
    }
}

TEST(DruckerPrager, PlasticVolumeGrowsByTheDilatancyAngle) {
  for (const ConeFit fit : fits)
    for (const double dilatancy : {0.0, 0.2, friction}) {
      const DruckerPrager rock = soil(fit, dilatancy);
      Specimen block(rock);
      Mat<3> F = 0.98 * Mat<3>::Identity();
      block.to(F);
      const Vector before = block.history();
      F(0, 1) = 0.08;
      block.to(F);
      const Vector flow = block.history() - before;
      const double volume = flow.head<3>().sum();
      const Vec<3> normal = flow.head<3>().array() - volume / 3.0;
      const double shear = std::sqrt(2.0 * normal.squaredNorm() + 4.0 * flow.segment<3>(3).squaredNorm());
      // d eps = dg (s / (2 sqrt(J2)) + eta' / 3): volume / shear = eta' for a shear of sqrt(2) |dev|.
      const double t = std::tan(dilatancy), s = std::sin(dilatancy);
      const double eta = fit == ConeFit::plane_strain
                             ? 3.0 * t / std::sqrt(9.0 + 12.0 * t * t)
                             : 6.0 * s / std::sqrt(3.0) / (fit == ConeFit::compression ? 3.0 - s : 3.0 + s);
      EXPECT_GT(shear, 0.004);
      EXPECT_NEAR(volume / shear, eta, 1e-13);
    }
}

TEST(DruckerPrager, PointsWithoutTangentsHaveTheSameStressAndHistoryAsThoseWith) {
  // Eight at a time without principal axes, and one by one in these: elastic, on the cone, at the apex, and strained by
  // so much that the former leave them to the latter.
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  for (const double dilatancy : {0.0, 0.2, friction})
    for (const double size : {1e-4, 3e-3, 0.02, 0.3}) {
      const DruckerPrager rock = soil(ConeFit::plane_strain, dilatancy, Strain::finite);
      constexpr Index n = 37;
      Deformation points = Deformation::none(Points<3>::Zero(3, n), rock.history_size());
      points.dt = 1.0;
      for (int step = 0; step < 2; ++step) {
        for (Index p = 0; p < n; ++p)
          for (int k = 0; k < 9; ++k) points.F(k, p) += size * (number(generator) + (k % 4 == 0 ? 0.3 : 0.0));
        const MaterialResponse in_axes = respond(rock, points, true), eight = respond(rock, points, false);
        const double scale = in_axes.P.cwiseAbs().maxCoeff();
        EXPECT_LT((in_axes.P - eight.P).cwiseAbs().maxCoeff(), 1e-9 * scale + 1e-12);
        EXPECT_LT((in_axes.history - eight.history).cwiseAbs().maxCoeff(), 1e-11);
        EXPECT_LT((in_axes.energy - eight.energy).cwiseAbs().maxCoeff(), 1e-11);
        EXPECT_LT((in_axes.dissipated - eight.dissipated).cwiseAbs().maxCoeff(), 1e-11);
        EXPECT_EQ((eight.dissipated.array() > 0.0).any(), size > 1e-3);
        points.history = eight.history;
      }
    }
}

TEST(DruckerPrager, RefusesParametersOutOfRange) {
  const auto refuses = [](DruckerPragerParameters parameters, const char* part) {
    EXPECT_THAT([&] { DruckerPrager{parameters}; }, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses({.moduli = moduli, .cohesion = c, .friction = 30.0}, "friction angle 30 rad, expected one in [0, pi / 2)");
  refuses({.moduli = moduli, .cohesion = c, .friction = 0.3, .dilatancy = 0.4}, "dilatancy angle 0.4 rad");
  refuses({.moduli = {.nu = 0.2}, .cohesion = c}, "nu given, expected two");
}

}  // namespace
}  // namespace efree
