// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/moduli.hpp"
#include "efree/core/error.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <gmock/gmock.h>

namespace efree {
namespace {

TEST(Moduli, AnyTwoSayTheSame) {
  for (const double nu : {-0.6, 0.28, 0.4999}) {
    const double E = 7.0, mu = E / (2.0 * (1.0 + nu)), kappa = E / (3.0 * (1.0 - 2.0 * nu)),
                 lambda = kappa - 2.0 / 3.0 * mu;
    for (const ElasticModuli& two :
         {ElasticModuli{.E = E, .nu = nu}, ElasticModuli{.E = E, .mu = mu}, ElasticModuli{.E = E, .kappa = kappa},
          ElasticModuli{.E = E, .lambda = lambda}, ElasticModuli{.nu = nu, .mu = mu},
          ElasticModuli{.nu = nu, .kappa = kappa}, ElasticModuli{.nu = nu, .lambda = lambda},
          ElasticModuli{.mu = mu, .kappa = kappa}, ElasticModuli{.mu = mu, .lambda = lambda},
          ElasticModuli{.kappa = kappa, .lambda = lambda}}) {
      const ElasticConstants found = two.checked().at(Vec<3>::Zero());
      // Shear is a difference of bulk moduli, or bulk of shear ones, where these are given: digits go with kappa / mu.
      const double digits = 1e-14 * (1.0 + kappa / mu);
      EXPECT_NEAR(found.mu / mu, 1.0, digits) << nu;
      EXPECT_NEAR(found.kappa / kappa, 1.0, digits) << nu;
      EXPECT_NEAR(found.lambda, lambda, digits * kappa) << nu;
    }
  }
}

TEST(Moduli, FieldsAreThoseOfThePlace) {
  const ElasticModuli graded{.nu = 0.25, .mu = [](const Vec<3>& X) { return 1.0 + X[0]; }};
  EXPECT_FALSE(graded.checked().is_constant());
  EXPECT_DOUBLE_EQ(graded.at({1.0, 0.0, 0.0}).lambda, 2.0);
  EXPECT_THAT(
      [&] {
        graded.at({-3.0, 1.0, 2.0});
      },
      ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("at (-3, 1, 2): shear modulus mu = -2")));
}

TEST(Moduli, RefuseWhatIsNoMaterial) {
  const auto refuses = [](const ElasticModuli& moduli, const char* part) {
    EXPECT_THAT([&] { LinearElastic{moduli}; }, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses({}, "none given, expected two of E, nu, mu, kappa, lambda");
  refuses({.E = 1.0}, "E given, expected two");
  refuses({.E = 1.0, .nu = 0.3, .mu = 1.0}, "E, nu, mu given, expected two");
  refuses({.E = 1.0, .nu = 0.5}, "nu = 0.5, expected a number in (-1, 0.5)");
  refuses({.E = 0.0, .nu = 0.2}, "E = 0");
  refuses({.E = 3.5, .mu = 1.0}, "E = 3.5, mu = 1 make");
  refuses({.mu = 1.0, .lambda = -1.0}, "bulk modulus of -0.333333");
  refuses({.nu = 0.6, .kappa = [](const Vec<3>&) { return 1.0; }}, "nu = 0.6");
  refuses({.nu = 0.0, .lambda = 0.0}, "make a shear modulus of");
}

}  // namespace
}  // namespace efree
