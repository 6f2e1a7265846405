// SPDX-License-Identifier: GPL-3.0-or-later
/// What holds for every plastic material.
#include "efree/materials/plasticity.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/materials/rankine.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>
#include <Eigen/Eigenvalues>
#include <cstdlib>
#include <functional>

namespace efree {
namespace {

using testing::rotation;

const ElasticModuli moduli{.mu = 1.0, .kappa = 2.0};

struct PlasticMaterial {
  std::string name;
  SharedMaterial material;
  /// How far a (Kirchhoff) stress is outside of the yield surface, by the stress and the history.
  std::function<double(const Mat<3>&, const Vector&)> outside;
};

Mat<3> deviator(const Mat<3>& stress) {
  return stress - stress.trace() / 3.0 * Mat<3>::Identity();
}

PlasticMaterial j2(std::string name, const Hardening& yield, double kinematic, Strain strain) {
  return {std::move(name), J2({.moduli = moduli, .yield = yield, .kinematic = kinematic, .strain = strain}),
          [=](const Mat<3>& stress, const Vector& history) {
            Mat<3> plastic;
            plastic << history[0], history[5], history[4], history[5], history[1], history[3], history[4], history[3],
                history[2];
            return std::sqrt(1.5) * (deviator(stress) - 2.0 / 3.0 * kinematic * plastic).norm() -
                   yield.at(history[6]).stress;
          }};
}
PlasticMaterial drucker_prager(std::string name, const Hardening& cohesion, double friction, double dilatancy,
                               Strain strain) {
  // The outer edges of Mohr and Coulomb's pyramid.
  const double eta = 6.0 * std::sin(friction) / (std::sqrt(3.0) * (3.0 - std::sin(friction)));
  const double xi = 6.0 * std::cos(friction) / (std::sqrt(3.0) * (3.0 - std::sin(friction)));
  return {std::move(name),
          DruckerPrager(
              {.moduli = moduli, .cohesion = cohesion, .friction = friction, .dilatancy = dilatancy, .strain = strain}),
          [=](const Mat<3>& stress, const Vector& history) {
            return deviator(stress).norm() / std::sqrt(2.0) + eta * stress.trace() / 3.0 -
                   xi * cohesion.at(history[6]).stress;
          }};
}
PlasticMaterial rankine(std::string name, double strength, double softening, Strain strain) {
  return {std::move(name), Rankine({.moduli = moduli, .strength = strength, .softening = softening, .strain = strain}),
          [=](const Mat<3>& stress, const Vector& history) {
            const Mat<3> both = 0.5 * (stress + stress.transpose());
            return Eigen::SelfAdjointEigenSolver<Mat<3>>(both).eigenvalues()[2] -
                   std::max(strength - softening * history[6], 0.0);
          }};
}

std::vector<PlasticMaterial> plastic_materials() {
  const Hardening swift = Hardening::power_law(0.05, 0.02, 0.3), voce = Hardening::voce(0.05, 0.09, 10.0, 0.05),
                  linear = Hardening::linear(0.05, 0.2), table = Hardening::table({0.0, 0.04, 0.3}, {0.05, 0.07, 0.06});
  return {j2("J2, perfect", 0.05, 0.0, Strain::small),
          j2("J2, linear and kinematic", linear, 0.3, Strain::small),
          j2("J2, table", table, 0.0, Strain::small),
          j2("J2, finite, Voce", voce, 0.0, Strain::finite),
          j2("J2, finite, Swift", swift, 0.0, Strain::finite),
          drucker_prager("Drucker-Prager", 0.05, 0.5, 0.5, Strain::small),
          drucker_prager("Drucker-Prager, hardening", linear, 0.3, 0.3, Strain::small),
          drucker_prager("Drucker-Prager, not associated", voce, 0.5, 0.2, Strain::small),
          drucker_prager("Drucker-Prager, without dilatancy", 0.05, 0.6, 0.0, Strain::small),
          drucker_prager("Drucker-Prager, without friction", 0.05, 0.0, 0.0, Strain::small),
          drucker_prager("Drucker-Prager, finite", linear, 0.5, 0.5, Strain::finite),
          drucker_prager("Drucker-Prager, finite, not associated", swift, 0.5, 0.1, Strain::finite),
          rankine("Rankine, perfect", 0.05, 0.0, Strain::small),
          rankine("Rankine, softening", 0.08, 0.4, Strain::small),
          rankine("Rankine, finite, softening", 0.08, 0.4, Strain::finite)};
}

Mat<3> yield_stress_of(const PlasticMaterial& one, const MaterialResponse& response, const Deformation& at, Index p) {
  const Mat<3> P = Eigen::Map<const Mat<3>>(response.P.col(p).data());
  return one.material->finite_strain() ? Mat<3>(P * at.gradient(p).transpose()) : P;
}

/// Points that have been deformed at random in two steps, and are by a third; the same whatever was drawn before.
Deformation after_steps(const Material& material, Index points, double size) {
  std::srand(1);
  Deformation at = Deformation::none(Points<3>::Random(3, points), material.history_size());
  for (int k = 0; k < 2; ++k) {
    at.F += size * Tensors::Random(9, points);
    at.history = respond(material, at, false).history;
  }
  at.F += size * Tensors::Random(9, points);
  return at;
}

TEST(Plasticity, StressesAreOnTheYieldSurfaceOrInside) {
  for (const PlasticMaterial& one : plastic_materials())
    for (const double size : {0.01, 0.05, 0.2}) {
      const Deformation at = after_steps(*one.material, 300, size);
      const MaterialResponse response = respond(*one.material, at, false);
      int plastic = 0;
      for (Index p = 0; p < at.size(); ++p) {
        const double f = one.outside(yield_stress_of(one, response, at, p), response.history.col(p));
        EXPECT_LT(f, 1e-12) << one.name;
        if (response.history(6, p) > at.history(6, p)) {
          ++plastic;
          EXPECT_GT(f, -1e-12) << one.name;
          EXPECT_GT(response.dissipated[p], -1e-15) << one.name;
        } else {
          EXPECT_EQ(response.history.col(p), at.history.col(p)) << one.name;
          EXPECT_EQ(response.dissipated[p], 0.0) << one.name;
        }
      }
      EXPECT_GT(plastic, size < 0.02 ? 1 : 100) << one.name << " " << size;
      EXPECT_TRUE(plastic < 300 || size > 0.02) << one.name << " " << size;
    }
}

TEST(Plasticity, TangentsAreDerivativesAndSymmetricIfTheySayItAndThenStressesHaveAPotential) {
  for (const PlasticMaterial& one : plastic_materials())
    for (const double size : {0.02, 0.15}) {
      const Deformation at = after_steps(*one.material, 150, size);
      const auto [stress, tangent] = testing::derivative_errors(*one.material, at, 2e-6);
      EXPECT_LT(tangent, 2e-9) << one.name << " " << size;
      EXPECT_TRUE(stress < 2e-10 || !one.material->symmetric()) << one.name << " " << size << ": " << stress;
      const MaterialResponse response = respond(*one.material, at, true);
      double largest = 0.0;
      for (Index p = 0; p < at.size(); ++p) {
        const MaterialResponse::Tangent A = response.tangent_at(p);
        largest = std::max(largest, (A - A.transpose()).cwiseAbs().maxCoeff());
      }
      EXPECT_EQ(largest < 1e-12, one.material->symmetric()) << one.name << " " << size << ": " << largest;
    }
}

TEST(Plasticity, TangentsHoldWherePrincipalStrainsAreEqualOrNearlySo) {
  for (const PlasticMaterial& one : plastic_materials())
    for (const double stretch : {0.9, 1.02, 1.2}) {
      const Tensors F = testing::nearly_equal_stretches(stretch);
      Deformation at = Deformation::none(Points<3>::Zero(3, F.cols()), one.material->history_size());
      at.F = F;
      // At small strains the same as symmetric gradients.
      if (!one.material->finite_strain())
        for (Index p = 0; p < at.size(); ++p) {
          const Mat<3> C = at.gradient(p).transpose() * at.gradient(p);
          at.F.col(p) = (0.5 * (C + Mat<3>::Identity())).reshaped();
        }
      // Where all three strains meet a cone that is not associated has a tip of its own, without a derivative.
      if (!one.material->symmetric()) {
        std::vector<Index> kept;
        for (Index p = 1; p < at.size(); ++p)
          if (p % 3 != 1) kept.push_back(p);
        at = {at.X(Eigen::all, kept), at.F(Eigen::all, kept), at.history(Eigen::all, kept)};
      }
      EXPECT_LT(testing::derivative_errors(*one.material, at, 1e-6).tangent, 1e-8) << one.name << " " << stretch;
    }
}

TEST(Plasticity, FiniteStrainsTurnWithTheBodyAndRememberNothingOfTheTurn) {
  const Mat<3> Q = rotation(2.0, {1.0, -0.4, 0.3});
  for (const PlasticMaterial& one : plastic_materials()) {
    if (!one.material->finite_strain()) continue;
    Deformation at = after_steps(*one.material, 50, 0.1), turned = at;
    for (Index p = 0; p < at.size(); ++p) turned.F.col(p) = (Q * at.gradient(p)).reshaped();
    auto a = respond(*one.material, at, false), b = respond(*one.material, turned, false);
    for (Index p = 0; p < at.size(); ++p)
      EXPECT_LT((b.stress(p) - Q * a.stress(p)).cwiseAbs().maxCoeff(), 1e-13) << one.name;
    EXPECT_LT((a.history - b.history).cwiseAbs().maxCoeff(), 1e-13) << one.name;
    EXPECT_LT((a.energy - b.energy).cwiseAbs().maxCoeff(), 1e-14) << one.name;
    EXPECT_LT((a.dissipated - b.dissipated).cwiseAbs().maxCoeff(), 1e-14) << one.name;
  }
}

TEST(Plasticity, WorkIsWhatIsStoredAndWhatIsDissipated) {
  for (const PlasticMaterial& one : plastic_materials()) {
    // Around a loop, in steps so small that backward Euler's error is: of first order.
    testing::Specimen specimen(*one.material);
    Mat<3> shape;
    shape << 1.0, 0.4, 0.0, 0.2, -0.3, 0.5, 0.0, 0.1, 0.2;
    double work = 0.0;
    Mat<3> F = Mat<3>::Identity(), P = Mat<3>::Zero();
    constexpr int steps = 4000;
    for (int k = 1; k <= steps; ++k) {
      const double s = 2.0 * 3.14159265358979 * k / steps;
      const Mat<3> next = Mat<3>::Identity() + 0.1 * (std::sin(s) * shape + (1.0 - std::cos(s)) * shape.transpose());
      specimen.to(next);
      work += 0.5 * (P + specimen.P()).cwiseProduct(next - F).sum();
      F = next;
      P = specimen.P();
    }
    EXPECT_GT(specimen.dissipated, 0.001) << one.name;
    EXPECT_NEAR(work / (specimen.response.energy[0] + specimen.dissipated), 1.0, 2e-3) << one.name;
  }
}

TEST(Plasticity, BelowYieldIsElasticityAndNothingIsRemembered) {
  const LinearElastic small(moduli);
  const Hencky finite(moduli);
  for (const PlasticMaterial& one : plastic_materials()) {
    const Material& elastic = one.material->finite_strain() ? static_cast<const Material&>(finite) : small;
    const Deformation at = testing::random_deformation(*one.material, 20, 0.008);
    Deformation bare = at;
    bare.history.resize(0, 20);
    const auto found = respond(*one.material, at, true), expected = respond(elastic, bare, true);
    EXPECT_LT((found.P - expected.P).cwiseAbs().maxCoeff(), 1e-15) << one.name;
    EXPECT_LT((found.A - expected.A).cwiseAbs().maxCoeff(), 1e-14) << one.name;
    EXPECT_LT((found.energy - expected.energy).cwiseAbs().maxCoeff(), 1e-17) << one.name;
    EXPECT_EQ(found.history.cwiseAbs().maxCoeff(), 0.0) << one.name;
  }
}

TEST(Plasticity, SmallAndFiniteStrainsMeetWhereStrainsAreSmall) {
  const auto yield = [](double size) { return Hardening::linear(0.3 * size, 0.2); };
  const auto difference = [](const Material& small, const Material& finite, double size) {
    const Mat<3> H = size * Mat<3>{{1.0, 0.3, 0.2}, {0.3, -0.4, 0.1}, {0.2, 0.1, 0.7}};
    testing::Specimen a(small), b(finite);
    for (const double part : {0.5, 1.0, 0.2}) {
      a.to(Mat<3>::Identity() + part * H);
      b.to(Mat<3>::Identity() + part * H);
    }
    return (a.P() - b.P()).cwiseAbs().maxCoeff();
  };
  for (const double size : {1e-2, 1e-3, 1e-4}) {
    const J2 a({.moduli = moduli, .yield = yield(size)}),
        b({.moduli = moduli, .yield = yield(size), .strain = Strain::finite});
    EXPECT_LT(difference(a, b, size), 10.0 * size * size);
    const DruckerPrager c({.moduli = moduli, .cohesion = yield(size), .friction = 0.4}),
        d({.moduli = moduli, .cohesion = yield(size), .friction = 0.4, .strain = Strain::finite});
    EXPECT_LT(difference(c, d, size), 10.0 * size * size);
    const Rankine e({.moduli = moduli, .strength = size, .softening = 0.3, .strain = Strain::small}),
        f({.moduli = moduli, .strength = size, .softening = 0.3});
    EXPECT_LT(difference(e, f, size), 10.0 * size * size);
  }
}

TEST(Plasticity, WithoutATangentNoneIsMadeAndAnswersAreTheSame) {
  for (const PlasticMaterial& one : plastic_materials()) {
    const Deformation at = after_steps(*one.material, 20, 0.1);
    const auto without = respond(*one.material, at, false), with = respond(*one.material, at, true);
    EXPECT_EQ(without.A.size(), 0) << one.name;
    EXPECT_EQ(without.P, with.P) << one.name;
    EXPECT_EQ(without.history, with.history) << one.name;
    EXPECT_FALSE(one.material->elastic() || one.material->linear()) << one.name;
    const auto parts = one.material->history_parts();
    ASSERT_GE(parts.size(), 2u);
    EXPECT_EQ(parts[1].name, "equivalent_plastic_strain");
    EXPECT_EQ(parts[1].offset, 6);
  }
}

TEST(Plasticity, WhatHasNoAnswerIsAnErrorThatNamesThePlace) {
  for (const PlasticMaterial& one : plastic_materials()) {
    Deformation at = testing::deformed(*one.material, Vec<3>(1.0, 1.0, std::nan("")).asDiagonal());
    at.X.col(0) << 0.5, -1.0, 2.0;
    const auto ask = [&] { respond(*one.material, at, false); };
    EXPECT_THAT(ask, ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("at (0.5, -1, 2)"))) << one.name;
    if (!one.material->finite_strain()) continue;
    at.F(8, 0) = -1.0;
    EXPECT_THAT(ask, ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("turned inside out"))) << one.name;
  }
}

TEST(Plasticity, SofteningFasterThanStressCanFollowIsAnError) {
  const Hardening brittle = Hardening::linear(0.05, -5.0);
  const Mat<3> sheared{{1.0, 0.2, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
  const J2 metal({.moduli = moduli, .yield = brittle});
  const DruckerPrager rock({.moduli = moduli, .cohesion = brittle, .friction = 0.3});
  for (const Material* material : {static_cast<const Material*>(&metal), static_cast<const Material*>(&rock)}) {
    const auto ask = [&] { respond(*material, testing::deformed(*material, sheared), false); };
    EXPECT_THAT(ask, ::testing::ThrowsMessage<NumericalError>(
                         ::testing::HasSubstr("softens faster than its stress can follow at (0, 0, 0)")));
  }
}

}  // namespace
}  // namespace efree
