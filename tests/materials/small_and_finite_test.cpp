// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/small_and_finite.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/tests/materials/derivatives.hpp"

#include <gmock/gmock.h>
#include <vector>

namespace efree {
namespace {

using testing::deformed, testing::rotation;

const OrthotropicModuli wood{{11.0, 0.9, 0.5}, {0.3, 0.4, 0.35}, {0.05, 0.6, 0.7}};

TEST(SmallAndFinite, LinearisedIsTheTangentAtRestWhateverTheStrain) {
  const ElasticModuli moduli{.E = 2.0, .nu = 0.3};
  const LinearElastic linear(moduli);
  for (const SharedMaterial& of : std::vector<SharedMaterial>{
           NeoHookean(moduli), Hencky(moduli), StVenantKirchhoff(moduli), J2({.moduli = moduli, .yield = 0.01}),
           J2({.moduli = moduli, .yield = 0.01, .strain = Strain::finite})}) {
    const Linearised same(of);
    EXPECT_TRUE(same.linear() && same.elastic() && same.homogeneous() && !same.finite_strain());
    const auto at = testing::random_deformation(linear, 20, 0.5);
    const auto expected = respond(linear, at, true), found = respond(same, at, true);
    EXPECT_LT((found.P - expected.P).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((found.A - expected.A).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((found.energy - expected.energy).cwiseAbs().maxCoeff(), 1e-13);
  }
}

TEST(SmallAndFinite, FieldsOfModuliStayFields) {
  const auto E = [](const Vec<3>& X) { return 1.0 + X[0]; };
  Deformation at = Deformation::none((Points<3>(3, 2) << 0.0, 2.0, 0.0, 0.0, 0.0, 0.0).finished());
  at.F.row(0).array() += 0.1;
  for (const SharedMaterial& of :
       std::vector<SharedMaterial>{Linearised(NeoHookean({.E = E, .nu = 0.3})), GreenElastic(LinearElastic(E, 0.3))}) {
    EXPECT_FALSE(of->homogeneous());
    const auto response = respond(*of, at, false);
    EXPECT_LT((response.P.col(1) - 3.0 * response.P.col(0)).norm(), 1e-14);
  }
}

TEST(SmallAndFinite, GreenElasticIsStVenantKirchhoffWhereThatIsIsotropic) {
  const ElasticModuli moduli{.E = 2.0, .nu = 0.3};
  const StVenantKirchhoff known(moduli);
  const auto at = testing::random_deformation(known, 20, 0.3);
  const auto expected = respond(known, at, true), found = respond(GreenElastic(LinearElastic(moduli)), at, true);
  EXPECT_LT((found.P - expected.P).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((found.A - expected.A).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT((found.energy - expected.energy).cwiseAbs().maxCoeff(), 1e-13);
}

TEST(SmallAndFinite, GreenElasticHasAPotentialAndTurnsWithTheBody) {
  const GreenElastic material{OrthotropicElastic(wood)};
  auto at = testing::random_deformation(material, 20, 0.3);
  const auto [stress, tangent] = testing::derivative_errors(material, at, 1e-3);
  EXPECT_LT(stress, 2e-9);
  EXPECT_LT(tangent, 2e-8);
  const Mat<3> Q = rotation(1.1, {0.3, -0.8, 0.5}), F = at.gradient(0);
  const Mat<3> P = respond(material, deformed(material, F), false).stress(0);
  const Mat<3> turned = respond(material, deformed(material, Q * F), false).stress(0);
  EXPECT_LT((turned - Q * P).norm(), 1e-13 * P.norm());
}

TEST(SmallAndFinite, GreenElasticIsOfLinearMaterialsOnly) {
  EXPECT_THROW(GreenElastic(NeoHookean({.E = 1.0, .nu = 0.3})), InputError);
  const GreenElastic material{OrthotropicElastic(wood)};
  EXPECT_THROW(respond(material, deformed(material, Vec<3>(-1.0, 1.0, 1.0).asDiagonal()), false), NumericalError);
}

}  // namespace
}  // namespace efree
