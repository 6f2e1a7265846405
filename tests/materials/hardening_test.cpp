// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/hardening.hpp"

#include "efree/core/error.hpp"

#include <gmock/gmock.h>
#include <cmath>

namespace efree {
namespace {

std::vector<Hardening> hardening_laws() {
  return {
      450.0,
      Hardening::linear(450.0, 130.0),
      Hardening::linear(450.0, -900.0),
      Hardening::power_law(450.0, 0.002, 0.2),
      Hardening::ludwik(450.0, 300.0, 1.0),
      Hardening::voce(450.0, 715.0, 16.93, 129.24),
      Hardening::voce(450.0, 300.0, 5.0),
      Hardening::table({0.0, 0.1, 0.25, 0.7}, {450.0, 500.0, 480.0, 600.0}),
      Hardening([](double a) { return 450.0 + 100.0 * std::sin(a); }, [](double a) { return 100.0 * std::cos(a); })};
}

TEST(Hardening, SlopesAndWorkAreDerivativeAndIntegralOfTheYieldStress) {
  for (std::size_t k = 0; const Hardening& hardening : hardening_laws()) {
    for (const double a : {0.0, 0.03, 0.2, 0.41, 0.63, 1.2}) {
      const double h = 1e-6;
      const auto [stress, slope] = hardening.at(a + h);
      EXPECT_NEAR((hardening.at(a + 2.0 * h).stress - hardening.at(a).stress) / (2.0 * h), slope,
                  1e-5 * (1.0 + std::abs(slope)))
          << k << " " << a;
      EXPECT_NEAR((hardening.work(0.0, a + 2.0 * h) - hardening.work(0.0, a)) / (2.0 * h), stress, 1e-5)
          << k << " " << a;
      EXPECT_NEAR(hardening.work(a, a + 0.2), hardening.work(0.0, a + 0.2) - hardening.work(0.0, a),
                  k == 8 ? 2e-9 : 1e-11)
          << k << ": of the function by Gauss's rule, over 1.4 of a sine";
    }
    EXPECT_NEAR(hardening.at(0.0).stress, 450.0, 1e-12) << k;
    ++k;
  }
}

TEST(Hardening, IsTheLawThatWasAskedFor) {
  EXPECT_DOUBLE_EQ(Hardening::linear(450.0, 130.0).at(0.5).stress, 515.0);
  EXPECT_DOUBLE_EQ(Hardening::power_law(450.0, 0.002, 0.2).at(0.4).stress, 450.0 * std::pow(201.0, 0.2));
  EXPECT_DOUBLE_EQ(Hardening::voce(450.0, 715.0, 16.93, 129.24).at(0.1).stress,
                   450.0 + 129.24 * 0.1 + 265.0 * (1.0 - std::exp(-1.693)));
  const Hardening ludwik = Hardening::ludwik(90.0, 292.0, 0.31);
  EXPECT_DOUBLE_EQ(ludwik.at(0.0).stress, 90.0);
  EXPECT_TRUE(std::isinf(ludwik.at(0.0).slope));
  EXPECT_DOUBLE_EQ(ludwik.at(0.3).stress, 90.0 + 292.0 * std::pow(0.3, 0.31));
  EXPECT_DOUBLE_EQ(ludwik.at(0.3).slope, 292.0 * 0.31 * std::pow(0.3, -0.69));
  EXPECT_DOUBLE_EQ(ludwik.work(0.0, 0.3), 27.0 + 292.0 / 1.31 * std::pow(0.3, 1.31));
  EXPECT_NEAR(ludwik.work(0.2, 0.2 + 1e-9) / 1e-9, ludwik.at(0.2).stress, 1e-5) << "no difference of large numbers";
  EXPECT_EQ(Hardening::ludwik(90.0, 0.0, 0.31).at(0.0).slope, 0.0);
  const Hardening table = Hardening::table({0.0, 0.1, 0.3}, {450.0, 500.0, 480.0});
  EXPECT_DOUBLE_EQ(table.at(0.05).stress, 475.0);
  EXPECT_DOUBLE_EQ(table.at(0.2).stress, 490.0);
  EXPECT_DOUBLE_EQ(table.at(7.0).stress, 480.0);
  EXPECT_EQ(table.at(7.0).slope, 0.0);
  EXPECT_TRUE(table.falls());
  EXPECT_FALSE(Hardening::table({0.0, 0.1, 0.3}, {450.0, 500.0, 500.0}).falls());
}

TEST(Hardening, SofteningEndsAtZero) {
  const Hardening softening = Hardening::linear(3.0, -6.0);
  EXPECT_EQ(softening.at(0.6).stress, 0.0);
  EXPECT_EQ(softening.at(0.6).slope, 0.0);
  EXPECT_DOUBLE_EQ(softening.work(0.0, 9.0), 0.75);
  const Hardening function([](double a) { return 1.0 - a; }, [](double) { return -1.0; });
  EXPECT_EQ(function.at(2.0).stress, 0.0);
}

TEST(Hardening, RefusesWhatIsNoYieldStress) {
  const auto refuses = [](const auto& work, const char* part) {
    EXPECT_THAT(work, ::testing::ThrowsMessage<InputError>(::testing::HasSubstr(part)));
  };
  refuses([] { Hardening(-1.0); }, "yield stress = -1");
  refuses([] { Hardening::linear(1.0, std::nan("")); }, "modulus = nan");
  refuses([] { Hardening::power_law(1.0, 0.0, 0.2); }, "strain of a power law = 0");
  refuses([] { Hardening::ludwik(1.0, -2.0, 0.3); }, "hardening modulus = -2");
  refuses([] { Hardening::ludwik(1.0, 2.0, 0.0); }, "exponent of Ludwik's law = 0");
  refuses([] { Hardening::voce(1.0, 2.0, -1.0); }, "rate of saturation = -1");
  refuses([] { Hardening::voce(1.0, 2.0, 1.0, -1.0); }, "modulus = -1");
  refuses([] { Hardening::table({0.0, 0.2}, {1.0}); }, "2 values of plastic strain and 1 of yield stress");
  refuses([] { Hardening::table({0.1}, {1.0}); }, "first plastic strain of a table = 0.1");
  refuses([] { Hardening::table({0.0, 0.2, 0.2}, {1.0, 1.0, 1.0}); }, "plastic strain 0.2 of a table after 0.2");
  refuses([] { Hardening::table({0.0, 0.2}, {1.0, -1.0}); }, "yield stress = -1");
  refuses([] { Hardening::table({0.0, std::nan("")}, {1.0, 1.0}); }, "plastic strain = nan");
  refuses([] { Hardening::table({}, {}); }, "0 values of plastic strain");
}

}  // namespace
}  // namespace efree
