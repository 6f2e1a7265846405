// SPDX-License-Identifier: GPL-3.0-or-later
/// Every material in plane stress: the strain across the plane is found from wherever it is looked for.
#include "efree/core/error.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/rankine.hpp"
#include "efree/tests/materials/derivatives.hpp"
#include "efree/tests/materials/paths.hpp"

#include <gmock/gmock.h>
#include <cstdlib>

namespace efree {
namespace {

using testing::deformed;
const std::vector<int> in_plane{0, 1, 3, 4};

struct SheetMaterial {
  const char* name;
  SharedMaterial material;
};
/// With mu = 1 and this bulk modulus.
std::vector<SheetMaterial> hyperelastic(double kappa) {
  const ElasticModuli moduli{.mu = 1.0, .kappa = kappa};
  return {{"neo-Hookean", NeoHookean(moduli)},
          {"neo-Hookean, split", NeoHookeanSplit(moduli)},
          {"Mooney-Rivlin", MooneyRivlin(0.4, 0.1, kappa)},
          {"Ogden", Ogden({{0.225, 6.3}, {0.375, 0.4}, {-0.21625, -2.0}}, kappa)},
          {"Hencky", Hencky(moduli)}};
}

/// With yield stresses of 0.05.
std::vector<SheetMaterial> plastic(double kappa) {
  const ElasticModuli moduli{.mu = 1.0, .kappa = kappa};
  const Hardening linear = Hardening::linear(0.05, 0.2), voce = Hardening::voce(0.05, 0.08, 10.0);
  return {{"J2, perfect", J2({.moduli = moduli, .yield = 0.05})},
          {"J2, kinematic", J2({.moduli = moduli, .yield = voce, .kinematic = 0.3})},
          {"J2, finite", J2({.moduli = moduli, .yield = linear, .strain = Strain::finite})},
          {"Drucker-Prager", DruckerPrager({.moduli = moduli, .cohesion = linear, .friction = 0.4})},
          {"Drucker-Prager, not associated",
           DruckerPrager({.moduli = moduli, .cohesion = voce, .friction = 0.5, .dilatancy = 0.1})},
          {"Drucker-Prager, finite",
           DruckerPrager({.moduli = moduli, .cohesion = 0.05, .friction = 0.4, .strain = Strain::finite})},
          {"Rankine", Rankine({.moduli = moduli, .strength = 0.05, .softening = 0.2, .strain = Strain::small})},
          {"Rankine, finite", Rankine({.moduli = moduli, .strength = 0.05, .softening = 0.1})}};
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

/// Sheets deformed at random in two steps, and by a third; the same whatever was drawn before.
Deformation sheets_after_steps(const Material& material, Index points, double size) {
  std::srand(1);
  Deformation at = Deformation::none(Points<3>::Zero(3, points), material.history_size());
  for (int step = 0; step < 3; ++step) {
    if (step > 0) at.history = respond(material, at, false).history;
    for (const int k : in_plane) at.F.row(k) += size * Matrix::Random(1, points);
  }
  return at;
}

TEST(PlaneStress, StressAndTangentOfPlasticSheetsAreDerivatives) {
  for (const double kappa : {1.0, 100.0})
    for (const auto& [name, material] : plastic(kappa))
      for (const double size : {0.02, 0.1}) {
        const PlaneStress in_sheet{material};
        const Deformation at = sheets_after_steps(in_sheet, 50, size);
        const auto [stress, tangent] = testing::derivative_errors(in_sheet, at, 2e-6, in_plane);
        EXPECT_LT(tangent, 5e-9) << name << " " << kappa << " " << size;
        EXPECT_TRUE(stress < 2e-10 || !in_sheet.symmetric()) << name << " " << kappa << " " << size << ": " << stress;
      }
}

TEST(PlaneStress, OfPlasticSheetsIsFoundInOneStepHoweverLarge) {
  for (const double kappa : {0.7, 10.0, 1e4})
    for (const auto& [name, material] : plastic(kappa))
      for (const Mat<3>& F : {sheet(1.5, 1.5), sheet(0.5, 0.5), sheet(3.0, 0.5), sheet(1.0, 1.0, 2.0),
                              sheet(0.3, 1.4, -0.5, 0.4), sheet(1.02, 0.99)}) {
        const PlaneStress in_sheet{material};
        const auto found = respond(in_sheet, deformed(in_sheet, F), true);
        Mat<3> whole = F;
        whole(2, 2) += found.history(material->history_size(), 0);
        const auto inside = respond(*material, deformed(*material, whole), true);
        EXPECT_LT(std::abs(inside.P(8, 0)), 1e-11 * (1.0 + kappa)) << name << " " << kappa << "\n" << F;
        EXPECT_LT((inside.P - found.P).cwiseAbs().maxCoeff(), 1e-11 * (1.0 + kappa)) << name << " " << kappa << "\n"
                                                                                     << F;
        EXPECT_TRUE(found.A.allFinite()) << name << " " << kappa << "\n" << F;
      }
}

TEST(PlaneStress, ASheetThatIsTornThroughHasNoStressAndCarriesPressureWhenClosed) {
  for (const Strain strain : {Strain::small, Strain::finite}) {
    const PlaneStress in_sheet{
        Rankine({.moduli = {.mu = 1.0, .kappa = 1.0}, .strength = 0.05, .softening = 0.5, .strain = strain})};
    testing::Specimen specimen(in_sheet);
    for (int k = 1; k <= 20; ++k) specimen.to(sheet(1.0 + 0.02 * k, 1.0 + 0.01 * k));
    EXPECT_EQ(specimen.P().cwiseAbs().maxCoeff(), 0.0);
    const Mat<3> open = specimen.F();
    EXPECT_TRUE(specimen.response.A.allFinite());
    specimen.to(open + Mat<3>(Vec<3>(-0.05, 0.05, 0.0).asDiagonal()));
    EXPECT_LT(specimen.P()(0, 0), -0.05);
    EXPECT_NEAR(specimen.P()(2, 2), 0.0, 1e-15);
    EXPECT_TRUE(specimen.response.A.allFinite());
  }
}

TEST(PlaneStress, AnInflatedIncompressibleSheetIsTheClosedForm) {
  // sigma = 2 (c10 + c01 l^2) (l^2 - 1 / l^4), thickness 1 / l^2, to the order of mu / kappa.
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
