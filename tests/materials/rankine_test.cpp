// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/rankine.hpp"

#include "efree/core/error.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>

namespace efree {
namespace {

using testing::rotation;
using testing::Specimen;

constexpr double E = 100.0, nu = 0.2, strength = 0.3, Gc = 0.002;
const ElasticModuli moduli{.E = E, .nu = nu};

TEST(Rankine, AnOpeningCrackLosesItsStrengthAndDissipatesTheFractureEnergy) {
  for (const Strain strain : {Strain::small, Strain::finite})
    for (const double length : {0.1, 0.4}) {
      const double alpha = softening_modulus(strength, Gc, length);
      const Rankine concrete({.moduli = moduli, .strength = strength, .softening = alpha, .strain = strain});
      Specimen bar(concrete, {4, 8});
      for (int k = 1; k <= 200; ++k) {
        const double e = 0.002 * k;
        bar.stretch_to(strain == Strain::small ? 1.0 + e : std::exp(e));
        const double stress = (strain == Strain::small ? bar.P() : bar.kirchhoff())(0, 0);
        const double a = e - stress / E;
        const double expected = e < strength / E ? E * e : std::max(strength - alpha * a, 0.0);
        ASSERT_NEAR(stress, expected, 1e-12) << k;
        ASSERT_NEAR(bar.equivalent(), e < strength / E ? 0.0 : a, 1e-13);
      }
      EXPECT_NEAR(bar.dissipated * length, Gc, 1e-14);
      EXPECT_EQ(bar.response.energy[0], 0.0);
    }
}

TEST(Rankine, SmallStrainsOfManyPointsAreThoseOfPrincipalAxes) {
  // Without tangents eight points at a time, by series where nothing tears; with tangents each along its axes.
  const Rankine concrete({.moduli = moduli, .strength = strength, .softening = 10.0});
  constexpr Index n = 21;
  Deformation given = Deformation::none(Points<3>::Zero(3, n), concrete.history_size());
  int plastic = 0;
  for (int step = 1; step <= 3; ++step) {
    for (Index p = 0; p < n; ++p) {
      const double size = 3e-4 * static_cast<double>(step * p);
      const Vec<3> strains(size, -0.4 * size, (p % 3 - 1.5) * size);
      const Mat<3> Q = rotation(0.3 * static_cast<double>(p), {1.0, 2.0, 0.5});
      const Mat<3> F =
          rotation(0.1 * step, {0.0, 1.0, 0.3}) * Q * strains.array().exp().matrix().asDiagonal() * Q.transpose();
      given.F.col(p) = F.reshaped();
    }
    const MaterialResponse fast = respond(concrete, given, false), exact = respond(concrete, given, true);
    EXPECT_LT((fast.P - exact.P).cwiseAbs().maxCoeff(), 1e-12 * E);
    EXPECT_LT((fast.history - exact.history).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((fast.energy - exact.energy).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_EQ(fast.dissipated, exact.dissipated);
    plastic += static_cast<int>((fast.dissipated.array() > 0.0).count());
    given.history = fast.history;
  }
  EXPECT_GT(plastic, 5);
  EXPECT_LT(plastic, 3 * n - 15);
}

TEST(Rankine, ClosesAgainUnderPressure) {
  const Rankine concrete({.moduli = moduli, .strength = strength, .softening = 10.0, .strain = Strain::small});
  Specimen bar(concrete, {4, 8});
  bar.stretch_to(1.01);
  const double opened = bar.equivalent();
  bar.stretch_to(1.0 + opened - 0.02);
  EXPECT_NEAR(bar.P()(0, 0), -0.02 * E, 1e-12);
  EXPECT_EQ(bar.equivalent(), opened);
}

TEST(Rankine, EveryDirectionTearsAtItsOwnStrengthOfOneKind) {
  // Two, then three equal strains: all their stresses are tau_C, the sum of what opens counts.
  const double alpha = 3.0, lambda = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), mu = E / (2.0 * (1.0 + nu));
  const Rankine concrete({.moduli = moduli, .strength = strength, .softening = alpha, .strain = Strain::small});
  const Mat<3> Q = rotation(0.9, {1.0, 2.0, 0.5});
  for (const int n : {1, 2, 3}) {
    Vec<3> strains = Vec<3>::Zero();
    strains.head(n).setConstant(0.01);
    auto response = respond(
        concrete, testing::deformed(concrete, Mat<3>::Identity() + Q * strains.asDiagonal() * Q.transpose()), false);
    const double trial = (n * lambda + 2.0 * mu) * 0.01;
    // n (trial - tau_C) = (n lambda + 2 mu) a, tau_C = strength - alpha a
    const double a = n * (trial - strength) / (n * lambda + 2.0 * mu - n * alpha);
    EXPECT_NEAR(response.history(6, 0), a, 1e-15);
    const Mat<3> stress = Q.transpose() * response.stress(0) * Q;
    for (int i = 0; i < n; ++i) EXPECT_NEAR(stress(i, i), strength - alpha * a, 1e-14) << n;
    for (int i = n; i < 3; ++i) EXPECT_NEAR(stress(i, i), lambda * (0.01 * n - a), 1e-14) << n;
  }
}

TEST(Rankine, FailedMatterCarriesPressureAsBeforeAndAShareOfShear) {
  for (const Strain strain : {Strain::small, Strain::finite}) {
    const Rankine concrete({.moduli = moduli,
                            .strength = strength,
                            .softening = 10.0,
                            .damage_threshold = 0.8,
                            .failed_shear = 0.1,
                            .strain = strain});
    const double mu = E / (2.0 * (1.0 + nu)), kappa = E / (3.0 * (1.0 - 2.0 * nu));
    // Squeezed, then torn along another axis: what shear stores is released when four fifths of the strength are lost.
    Specimen block(concrete);
    const auto state = [&](double squeezed, double torn) {
      Mat<3> F = Mat<3>::Identity();
      F(0, 0) += torn;
      F(1, 1) -= squeezed;
      return F;
    };
    double work = 0.0, failed_at = 0.0;
    Mat<3> before = Mat<3>::Identity(), P = Mat<3>::Zero();
    const auto go = [&](const Mat<3>& F) {
      block.to(F);
      work += 0.5 * (P + block.P()).cwiseProduct(F - before).sum();
      before = F;
      P = block.P();
      const double left = std::max(strength - 10.0 * block.equivalent(), 0.0);
      if (failed_at == 0.0 && left <= 0.2 * strength) failed_at = F(0, 0);
      const double tolerance = failed_at > 0.0 ? 1e-3 : 1e-4;  // stresses jump in the step in which it fails
      ASSERT_NEAR(block.response.energy[0] + block.dissipated, work, tolerance * std::max(work, 1e-3));
    };
    for (int k = 1; k <= 200; ++k) go(state(1e-4 * k, 0.0));
    for (int k = 1; k <= 2000; ++k) go(state(0.02, 4e-5 * k));
    EXPECT_GT(failed_at, 1.02);
    // The same law for many points without tangents.
    Deformation at = Deformation::none(Points<3>::Zero(3, 1), 7);
    at.history = block.history();
    Mat<3> F = block.F();
    F(0, 0) -= 0.1;
    at.F = F.reshaped();
    const MaterialResponse fast = respond(concrete, at, false), exact = respond(concrete, at, true);
    EXPECT_LT((fast.P - exact.P).norm(), 1e-13);
    // Under pressure.
    const auto stress = [&] { return Mat<3>(strain == Strain::small ? block.P() : block.kirchhoff()); };
    block.to(F);
    const Mat<3> tau = stress();
    ASSERT_LT(tau.trace(), 0.0);
    F(2, 2) += 1e-6;
    block.to(F);
    const Mat<3> change = stress() - tau;
    EXPECT_NEAR(change.trace() / 3.0, kappa * 1e-6, 1e-5 * kappa * 1e-6);
    EXPECT_NEAR(change(2, 2) - change(1, 1), 2.0 * 0.1 * mu * 1e-6, 1e-5 * mu * 1e-6);
  }
}

TEST(Rankine, CompressionAndShearBelowStrengthAreElastic) {
  const Rankine concrete({.moduli = moduli, .strength = strength, .softening = 10.0});
  Specimen one(concrete);
  one.to(0.5 * Mat<3>::Identity());
  EXPECT_EQ(one.equivalent(), 0.0);
  EXPECT_NEAR(one.kirchhoff()(0, 0), E / (1.0 - 2.0 * nu) * std::log(0.5), 1e-11);
}

TEST(Rankine, FieldsAreThoseOfThePlace) {
  const auto weaker = [](const Vec<3>& X) { return 0.1 + 0.05 * X[0] * X[0]; };
  const auto length = [&](const Vec<3>& X) { return softening_modulus(weaker(X), Gc, 0.1); };
  const Rankine graded({.moduli = moduli, .strength = weaker, .softening = length});
  EXPECT_FALSE(graded.homogeneous());
  const auto at = testing::random_deformation(graded, 5, 0.02);
  const auto found = respond(graded, at, false);
  for (Index p = 0; p < at.size(); ++p) {
    const Vec<3> X = at.X.col(p);
    const Rankine here({.moduli = moduli, .strength = weaker(X), .softening = length(X)});
    EXPECT_EQ(found.P.col(p), respond(here, Deformation{X, at.F.col(p), at.history.col(p)}, false).P);
  }
}

TEST(Rankine, RefusesParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses([] { Rankine({.moduli = moduli, .strength = -1.0}); }, "strength = -1");
  refuses([] { Rankine({.moduli = moduli, .strength = 1.0, .softening = 60.0}); },
          "softening = 60, expected one from 0 to less than the bulk modulus 55.5556");
  refuses(
      [] {
        const Rankine graded({.moduli = moduli, .strength = [](const Vec<3>& X) { return X[0]; }});
        respond(graded, Deformation::none(Points<3>::Constant(3, 1, -2.0), 7), false);
      },
      "strength = -2 at (-2, -2, -2)");
  refuses([] { Rankine({.moduli = moduli, .strength = 1.0, .failed_shear = 0.1}); },
          "failed_shear = 0.1: the strength never falls");
  refuses([] { Rankine({.moduli = moduli, .strength = 1.0, .softening = 1.0, .failed_shear = 0.0}); },
          "failed_shear = 0, expected more than 0, at most 1");
  refuses([] { softening_modulus(1.0, 0.0, 1.0); }, "fracture energy = 0");
}

}  // namespace
}  // namespace efree
