// SPDX-License-Identifier: GPL-3.0-or-later
/// Every material in plane stress: the strain across the plane is found from wherever it is looked for.
#include "efree/core/error.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/tests/materials/derivatives.hpp"

#include <gmock/gmock.h>
#include <memory>

namespace efree {
namespace {

using testing::deformed;
const std::vector<int> in_plane{0, 1, 3, 4};

struct Named {
  const char* name;
  SharedMaterial material;
};
/// With mu = 1 and this bulk modulus.
std::vector<Named> hyperelastic(double kappa) {
  const ElasticModuli moduli{.mu = 1.0, .kappa = kappa};
  return {{"neo-Hookean", NeoHookean(moduli)},
          {"neo-Hookean, split", NeoHookeanSplit(moduli)},
          {"Mooney-Rivlin", MooneyRivlin(0.4, 0.1, kappa)},
          {"Ogden", Ogden({{0.225, 6.3}, {0.375, 0.4}, {-0.21625, -2.0}}, kappa)},
          {"Hencky", Hencky(moduli)}};
}

Mat<3> sheet(double xx, double yy, double xy = 0.0, double yx = 0.0) {
  return Mat<3>{{xx, xy, 0.0}, {yx, yy, 0.0}, {0.0, 0.0, 1.0}};
}

TEST(PlaneStress, StressAndTangentOfHyperelasticSheetsAreDerivatives) {
  for (const double kappa : {1.0, 100.0})
    for (const auto& [name, material] : hyperelastic(kappa)) {
      const PlaneStress in_sheet{material};
      auto at = testing::random_deformation(in_sheet, 10, 0.3);
      for (const int k : {2, 5, 6, 7, 8}) at.F.row(k).setConstant(k == 8 ? 1.0 : 0.0);
      const auto [stress, tangent] = testing::derivative_errors(in_sheet, at, 1e-3, in_plane);
      EXPECT_LT(stress, 1e-9) << name << " " << kappa;
      EXPECT_LT(tangent, 1e-8) << name << " " << kappa;
    }
}

TEST(PlaneStress, IsFoundFromFarAwayHoweverIncompressible) {
  for (const double kappa : {0.7, 10.0, 1e4})
    for (const auto& [name, material] : hyperelastic(kappa))
      for (const Mat<3>& F : {sheet(10.0, 10.0), sheet(0.1, 0.1), sheet(8.0, 0.3), sheet(1.0, 1.0, 5.0),
                              sheet(-1.0, -1.0), sheet(0.2, 1.5, -2.0, 3.0)}) {
        const PlaneStress in_sheet{material};
        const auto found = respond(in_sheet, deformed(in_sheet, F), true);
        // By the material itself.
        Mat<3> whole = F;
        whole(2, 2) += found.history(0, 0);
        const auto inside = respond(*material, deformed(*material, whole), true);
        const double scale = inside.A.cwiseAbs().maxCoeff();
        EXPECT_LT(std::abs(inside.P(8, 0)), 1e-12 * scale) << name << " " << kappa << "\n" << F;
        EXPECT_LT((inside.P - found.P).cwiseAbs().maxCoeff(), 1e-11 * scale) << name << " " << kappa;
        EXPECT_EQ(found.P(8, 0), 0.0);
        EXPECT_GT(inside.A(80, 0), 0.0) << "stable across the plane: " << name << " " << kappa << "\n" << F;
      }
}

TEST(PlaneStress, AnInflatedIncompressibleSheetIsTheClosedForm) {
  // sigma = 2 (c10 + c01 l^2) (l^2 - 1 / l^4), thickness 1 / l^2 (Treloar 1944), to the order of mu / kappa.
  const double kappa = 1e9, l = 1.7;
  const PlaneStress in_sheet{MooneyRivlin(0.4, 0.1, kappa)};
  const auto found = respond(in_sheet, deformed(in_sheet, sheet(l, l)), false);
  EXPECT_NEAR(found.history(0, 0), 1.0 / (l * l) - 1.0, 1e-8);
  EXPECT_NEAR(found.P(0, 0) * l, 2.0 * (0.4 + 0.1 * l * l) * (l * l - std::pow(l, -4.0)), 1e-6);
}

TEST(PlaneStress, WhereThereIsNoEquilibriumAcrossNoneIsReported) {
  // With lambda < 0 nothing stops the published neo-Hookean material from collapsing under compression.
  const PlaneStress in_sheet{NeoHookean({.mu = 1.0, .kappa = 0.5})};
  const auto ask = [&] { respond(in_sheet, deformed(in_sheet, sheet(0.1, 0.1)), false); };
  EXPECT_THAT(ask, ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("plane stress: no strain across")));
}

TEST(PlaneStress, AnInsideOutSheetIsAnErrorThatNamesThePlace) {
  const PlaneStress in_sheet{NeoHookean({.nu = 0.3, .mu = 1.0})};
  const auto ask = [&] { respond(in_sheet, deformed(in_sheet, sheet(1.0, -1.0)), false); };
  EXPECT_THAT(ask, ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("at (0, 0, 0)")));
}

}  // namespace
}  // namespace efree
