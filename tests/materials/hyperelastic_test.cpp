// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/hyperelastic.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/internal/softened.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/tests/materials/derivatives.hpp"

#include <gmock/gmock.h>
#include <memory>

namespace efree {
namespace {

using testing::deformed;
using testing::rotation;

constexpr double mu = 0.8, kappa = 2.1;
const ElasticModuli moduli{.mu = mu, .kappa = kappa};
const std::vector<OgdenTerm> rubber{{0.18, 6.3}, {0.3, 0.4}, {-0.173, -2.0}};  // shear modulus 0.8

struct ElasticMaterial {
  const char* name;
  std::shared_ptr<Material> material;
};
/// All with the same shear and bulk modulus.
std::vector<ElasticMaterial> elastic_materials() {
  return {{"St. Venant-Kirchhoff", std::make_shared<StVenantKirchhoff>(moduli)},
          {"neo-Hookean", std::make_shared<NeoHookean>(moduli)},
          {"neo-Hookean, split", std::make_shared<NeoHookeanSplit>(moduli)},
          {"Mooney-Rivlin", std::make_shared<MooneyRivlin>(0.3, 0.1, kappa)},
          {"Ogden", std::make_shared<Ogden>(rubber, kappa)},
          {"Hencky", std::make_shared<Hencky>(moduli)}};
}

Mat<3> stress_of(const Material& material, const Mat<3>& F) {
  return respond(material, deformed(material, F), false).stress(0);
}
/// tau = P F^T.
Mat<3> kirchhoff(const Material& material, const Mat<3>& F) {
  return stress_of(material, F) * F.transpose();
}

TEST(Hyperelastic, StressAndTangentAreDerivativesOfTheEnergy) {
  for (const auto& [name, material] : elastic_materials()) {
    auto at = testing::random_deformation(*material, 20, 0.3);
    const auto [stress, tangent] = testing::derivative_errors(*material, at, 1e-3);
    // Fourth order: h^4 times fifth derivatives of what det F = 0.3 makes stiff.
    EXPECT_LT(stress, 2e-9) << name;
    EXPECT_LT(tangent, 2e-8) << name;
  }
}

TEST(Hyperelastic, ASoftenedMaterialHasAShareOfTheBulkModulusAndTheSameShearModulus) {
  constexpr double share = 0.01;
  for (const SharedMaterial& material :
       {SharedMaterial(NeoHookean(moduli)), SharedMaterial(MooneyRivlin(0.3, 0.1, kappa)),
        SharedMaterial(Hencky(moduli))}) {
    const internal::Softened softened(material, share);
    auto at = testing::random_deformation(softened, 20, 0.3);
    const auto [stress, tangent] = testing::derivative_errors(softened, at, 1e-3);
    EXPECT_LT(stress, 2e-9);
    EXPECT_LT(tangent, 2e-8);
    const auto at_rest = [](const Material& one) {
      return respond(one, Deformation::none(Points<3>::Zero(3, 1)), true).tangent_at(0).eval();
    };
    const auto all = at_rest(*material), soft = at_rest(softened);
    EXPECT_NEAR(incompressibility(soft), share * incompressibility(all), 1e-10 * incompressibility(all));
    const Mat<3> shear = (Mat<3>() << 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0).finished();
    EXPECT_NEAR(shear.reshaped().dot(soft * shear.reshaped()), shear.reshaped().dot(all * shear.reshaped()), 1e-12);
  }
}

TEST(Hyperelastic, StressAndTangentHoldWherePrincipalStretchesAreEqualOrNearlySo) {
  for (const auto& [name, material] : elastic_materials())
    for (const double stretch : {0.8, 1.0, 1.5}) {
      Deformation at = Deformation::none(Points<3>::Zero(3, 16));
      at.F = testing::nearly_equal_stretches(stretch);
      const auto [stress, tangent] = testing::derivative_errors(*material, at, 1e-3);
      EXPECT_LT(stress, 1e-10) << name << " " << stretch;
      EXPECT_LT(tangent, 2e-9) << name << " " << stretch;
    }
}

TEST(Hyperelastic, TangentsAreContinuousWherePrincipalStretchesMeet) {
  for (const auto& [name, material] : elastic_materials()) {
    const Mat<3> Q = rotation(0.7, {1.0, 1.0, 0.3});
    const auto tangent = [&, &one = *material](double apart) {
      const Vec<3> stretches(1.3, 1.3 + apart, 0.9);
      return Vector(respond(one, deformed(one, Mat<3>(stretches.asDiagonal()) * Q), true).A);
    };
    const Vector equal = tangent(0.0);
    for (const double apart : {1e-15, 1e-12, 1e-9, 1e-6})
      EXPECT_LT((tangent(apart) - equal).cwiseAbs().maxCoeff(), 20.0 * apart + 1e-13) << name << " " << apart;
  }
}

TEST(Hyperelastic, RotationsOfBodyAndOfMatterChangeNothingElse) {
  const Mat<3> Q = rotation(1.1, {0.3, -1.0, 0.5});
  for (const auto& [name, material] : elastic_materials()) {
    const auto at = testing::random_deformation(*material, 10, 0.3);
    auto turned = at, matter = at;
    for (Index p = 0; p < at.size(); ++p) {
      turned.F.col(p) = (Q * at.gradient(p)).reshaped();
      matter.F.col(p) = (at.gradient(p) * Q).reshaped();
    }
    auto a = respond(*material, at, true), b = respond(*material, turned, true), c = respond(*material, matter, true);
    MaterialResponse::Tangent turn = MaterialResponse::Tangent::Zero();
    for (int J = 0; J < 3; ++J) turn.block<3, 3>(3 * J, 3 * J) = Q;
    for (Index p = 0; p < at.size(); ++p) {
      const double scale = a.A.col(p).cwiseAbs().maxCoeff();
      EXPECT_LT((b.stress(p) - Q * a.stress(p)).cwiseAbs().maxCoeff(), 1e-13 * scale) << name;
      EXPECT_LT((c.stress(p) - a.stress(p) * Q).cwiseAbs().maxCoeff(), 1e-13 * scale) << name;
      EXPECT_LT((b.tangent_at(p) - turn * a.tangent_at(p) * turn.transpose()).cwiseAbs().maxCoeff(), 1e-12 * scale)
          << name;
      EXPECT_NEAR(b.energy[p], a.energy[p], 1e-14 * scale) << name;
      EXPECT_NEAR(c.energy[p], a.energy[p], 1e-14 * scale) << name;
    }
  }
}

TEST(Hyperelastic, SmallStrainsAreThoseOfLinearElasticityToTheirLastDigits) {
  const LinearElastic linear(moduli);
  const Mat<3> H = Mat<3>{{1.0, 0.3, -0.2}, {0.3, -0.6, 0.5}, {-0.2, 0.5, 0.1}};
  for (const auto& [name, material] : elastic_materials()) {
    auto rest = respond(*material, deformed(*material, Mat<3>::Identity()), true);
    const auto expected = respond(linear, deformed(linear, Mat<3>::Identity()), true);
    EXPECT_EQ(rest.P.cwiseAbs().maxCoeff(), 0.0) << name;
    EXPECT_EQ(rest.energy[0], 0.0) << name;
    EXPECT_LT((rest.A - expected.A).cwiseAbs().maxCoeff(), 4e-15) << name;
    for (const double size : {1e-3, 1e-6, 1e-9}) {
      const auto small = deformed(*material, Mat<3>::Identity() + size * H);
      const auto found = respond(*material, small, false), straight = respond(linear, small, false);
      // What F itself loses of H: 1e-16. What is not linear: the size of H.
      EXPECT_LT((found.P - straight.P).cwiseAbs().maxCoeff(), 10.0 * size * size + 1e-15) << name << " " << size;
      EXPECT_NEAR(found.energy[0] / straight.energy[0], 1.0, 3.0 * size + 1e-15 / size) << name << " " << size;
    }
  }
}

/// Stresses without their pressure, of a material with these differences between principal Kirchhoff stresses at
/// stretches whose product is one: closed forms.
template <class Difference> void expect_differences(const Material& material, const Difference& f) {
  for (const double l : {0.4, 0.8, 1.0, 2.0, 5.0}) {
    const double root = std::sqrt(l);
    const Mat<3> pull = Vec<3>(l, 1.0 / root, 1.0 / root).asDiagonal();
    const Mat<3> tau = kirchhoff(material, pull);
    const double scale = 1e-13 * (1.0 + tau.cwiseAbs().maxCoeff());
    EXPECT_NEAR(tau(0, 0) - tau(1, 1), f(l, 1.0 / root), scale) << "uniaxial " << l;
    EXPECT_NEAR(tau.trace(), 0.0, 3.0 * scale) << "no pressure without change of volume";
    const Mat<3> biaxial = Vec<3>(l, l, 1.0 / (l * l)).asDiagonal();
    const Mat<3> both = kirchhoff(material, biaxial);
    EXPECT_NEAR(both(0, 0) - both(2, 2), f(l, 1.0 / (l * l)), 1e-13 * (1.0 + both.cwiseAbs().maxCoeff()))
        << "equibiaxial " << l;
    EXPECT_NEAR(both(0, 0), both(1, 1), 1e-14 * both.cwiseAbs().maxCoeff());
  }
}

TEST(Hyperelastic, TensionAlongOneAndTwoAxesIsTheClosedForm) {
  expect_differences(NeoHookeanSplit(moduli), [](double a, double b) { return mu * (a * a - b * b); });
  // b - b^-1 of the second invariant, with l1 l2 l3 = 1.
  expect_differences(MooneyRivlin(0.3, 0.1, kappa), [](double a, double b) {
    return 2.0 * 0.3 * (a * a - b * b) - 2.0 * 0.1 * (1.0 / (a * a) - 1.0 / (b * b));
  });
  expect_differences(Ogden(rubber, kappa), [](double a, double b) {
    double sum = 0.0;
    for (const auto& [m, alpha] : rubber) sum += m * (std::pow(a, alpha) - std::pow(b, alpha));
    return sum;
  });
  expect_differences(Hencky(moduli), [](double a, double b) { return 2.0 * mu * std::log(a / b); });
}

TEST(Hyperelastic, SimpleShearIsTheClosedForm) {
  for (const double gamma : {0.1, 1.0, 3.0}) {
    Mat<3> F = Mat<3>::Identity();
    F(0, 1) = gamma;
    const Mat<3> mooney = kirchhoff(MooneyRivlin(0.3, 0.1, kappa), F);
    EXPECT_NEAR(mooney(0, 1), 2.0 * (0.3 + 0.1) * gamma, 1e-13);
    EXPECT_NEAR(mooney(0, 0) - mooney(1, 1), gamma * mooney(0, 1), 1e-12) << "Rivlin's universal relation";
    EXPECT_NEAR(kirchhoff(NeoHookean(moduli), F)(0, 1), mu * gamma, 1e-14);
    // Principal stretches l and 1/l with l - 1/l = gamma; l^2 along the axis at atan(2 / gamma) / 2.
    const double l = 0.5 * gamma + std::sqrt(1.0 + 0.25 * gamma * gamma);
    EXPECT_NEAR(kirchhoff(Hencky(moduli), F)(0, 1), 4.0 * mu * std::log(l) / std::sqrt(gamma * gamma + 4.0), 1e-13);
    const Mat<3> S = mu * Mat<3>{{0.0, gamma, 0.0}, {gamma, gamma * gamma, 0.0}, {0.0, 0.0, 0.0}} +
                     0.5 * (kappa - 2.0 / 3.0 * mu) * gamma * gamma * Mat<3>::Identity();
    EXPECT_LT((stress_of(StVenantKirchhoff(moduli), F) - F * S).cwiseAbs().maxCoeff(), 1e-12);
  }
}

TEST(Hyperelastic, NeoHookeanIsThePublishedCauchyStress) {
  const auto at = testing::random_deformation(NeoHookean(moduli), 10, 0.3);
  auto found = respond(NeoHookean(moduli), at, false);
  for (Index p = 0; p < at.size(); ++p) {
    const Mat<3> F = at.gradient(p), b = F * F.transpose();
    const double J = F.determinant();
    const Mat<3> sigma =
        mu / J * (b - Mat<3>::Identity()) + (kappa - 2.0 / 3.0 * mu) * std::log(J) / J * Mat<3>::Identity();
    EXPECT_LT((found.stress(p) * F.transpose() / J - sigma).cwiseAbs().maxCoeff(), 1e-13 / J);
  }
}

TEST(Hyperelastic, PressureIsThatOfTheVolumeAndUnboundedAtBothEnds) {
  for (const double J : {1e-3, 0.5, 1.0, 2.0, 50.0}) {
    const Mat<3> F = std::cbrt(J) * Mat<3>::Identity();
    for (const ElasticMaterial& one : {elastic_materials()[2], elastic_materials()[3], elastic_materials()[4]}) {
      const Mat<3> tau = kirchhoff(*one.material, F);
      EXPECT_LT((tau - 0.5 * kappa * (J * J - 1.0) * Mat<3>::Identity()).cwiseAbs().maxCoeff(), 1e-13 * (1.0 + J * J))
          << one.name << " J = " << J;
    }
    const double log_J = std::log(J);
    EXPECT_NEAR(kirchhoff(Hencky(moduli), F)(0, 0), kappa * log_J, 1e-12);
    EXPECT_NEAR(respond(Hencky(moduli), deformed(Hencky(moduli), F), false).energy[0], 0.5 * kappa * log_J * log_J,
                1e-11);
  }
}

TEST(Hyperelastic, OgdenWithPowersOfTwoIsMooneyRivlin) {
  const MooneyRivlin mooney(0.3, 0.1, kappa);
  const Ogden ogden({{0.6, 2.0}, {-0.2, -2.0}}, kappa);
  const auto at = testing::random_deformation(mooney, 20, 0.3);
  const auto a = respond(mooney, at, true), b = respond(ogden, at, true);
  for (Index p = 0; p < at.size(); ++p) {
    const double scale = a.A.col(p).cwiseAbs().maxCoeff();
    EXPECT_LT((a.P.col(p) - b.P.col(p)).cwiseAbs().maxCoeff(), 1e-13 * scale);
    EXPECT_LT((a.A.col(p) - b.A.col(p)).cwiseAbs().maxCoeff(), 1e-12 * scale);
    EXPECT_NEAR(a.energy[p], b.energy[p], 1e-14 * scale);
  }
}

TEST(Hyperelastic, UniaxialStressOfHenckyIsYoungsModulusTimesLogarithmicStrain) {
  const double E = 9.0 * kappa * mu / (3.0 * kappa + mu), nu = 0.5 * E / mu - 1.0;
  for (const double strain : {-1.0, 0.2, 1.5}) {
    const Vec<3> stretches(std::exp(strain), std::exp(-nu * strain), std::exp(-nu * strain));
    const Mat<3> tau = kirchhoff(Hencky(moduli), stretches.asDiagonal());
    EXPECT_NEAR(tau(0, 0), E * strain, 1e-13);
    EXPECT_NEAR(tau(1, 1), 0.0, 1e-13);
  }
}

TEST(Hyperelastic, MatterTurnedInsideOutIsAnErrorThatNamesThePlace) {
  for (const auto& [name, material] : elastic_materials())
    for (const double third : {-0.5, 0.0, std::nan("")}) {
      Deformation at = deformed(*material, Vec<3>(1.0, 2.0, third).asDiagonal());
      at.X.col(0) << 0.5, -1.0, 2.0;
      const auto ask = [&one = *material, &at] { respond(one, at, false); };
      EXPECT_THAT(ask,
                  ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("at (0.5, -1, 2) has the determinant")))
          << name;
    }
}

TEST(Hyperelastic, WithoutATangentNoneIsMadeAndStressesAreTheSame) {
  for (const auto& [name, material] : elastic_materials()) {
    const auto at = testing::random_deformation(*material, 5, 0.3);
    const auto without = respond(*material, at, false);
    EXPECT_EQ(without.A.size(), 0) << name;
    EXPECT_EQ(without.P, respond(*material, at, true).P) << name;
    EXPECT_TRUE(material->elastic() && material->finite_strain() && material->symmetric() && !material->linear());
  }
}

TEST(Hyperelastic, FieldsAreThoseOfThePlace) {
  const auto field = [](const Vec<3>& X) { return 1.0 + X.squaredNorm(); };
  const MooneyRivlin mooney(field, 0.1, field);
  EXPECT_FALSE(mooney.homogeneous());
  const auto at = testing::random_deformation(mooney, 4, 0.2);
  const auto found = respond(mooney, at, false), ogden = respond(Ogden(rubber, field), at, false),
             hencky = respond(Hencky({.nu = 0.3, .mu = field}), at, false);
  for (Index p = 0; p < at.size(); ++p) {
    const double here = field(at.X.col(p));
    const Deformation one{at.X.col(p), at.F.col(p), Matrix(0, 1)};
    EXPECT_EQ(found.P.col(p), respond(MooneyRivlin(here, 0.1, here), one, false).P);
    EXPECT_EQ(ogden.P.col(p), respond(Ogden(rubber, here), one, false).P);
    EXPECT_EQ(hencky.P.col(p), respond(Hencky({.nu = 0.3, .mu = here}), one, false).P);
  }
}

TEST(Hyperelastic, RefuseParametersOutOfRange) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses([] { NeoHookean({.E = 1.0, .nu = 0.5}); }, "nu = 0.5");
  refuses([] { Hencky({.mu = 1.0}); }, "mu given, expected two");
  refuses([] { MooneyRivlin(0.1, -0.1, 1.0); }, "c10 = 0.1, c01 = -0.1, expected a positive sum");
  refuses([] { MooneyRivlin(0.1, 0.1, 0.0); }, "kappa = 0, expected");
  refuses([] { Ogden({{1.0, -2.0}}, 1.0); }, "shear modulus of -1");
  refuses([] { Ogden({}, 1.0); }, "shear modulus of 0");
  refuses([] { Ogden({{1.0, 0.0}}, 1.0); }, "alpha = 0");
  refuses(
      [] {
        const Ogden graded(rubber, [](const Vec<3>& X) { return X[0]; });
        respond(graded, Deformation::none(Points<3>::Constant(3, 1, -2.0)), false);
      },
      "kappa = -2 at (-2, -2, -2)");
}

}  // namespace
}  // namespace efree
