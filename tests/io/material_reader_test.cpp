// SPDX-License-Identifier: GPL-3.0-or-later
/// Materials of explicit dynamics as cases name them.
#include "efree/io/case/internal/material_reader.hpp"

#include "efree/core/error.hpp"
#include "efree/materials/j2.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using ::testing::HasSubstr;

SharedMaterial read(const std::string& text) {
  const toml::table table = toml::parse("[material]\n" + text, std::string_view("case.toml"));
  CommonSettings<2> settings;
  const Expressions<2> expressions;
  internal::MaterialReader<2>(expressions).read(internal::Section(table, "", "case.toml", {}), settings);
  return settings.model.material;
}

/// Both answer the same, to the last bit, over two steps.
void expect_same(const SharedMaterial& found, const Material& expected) {
  std::srand(1);
  ASSERT_EQ(found->history_size(), expected.history_size());
  Deformation at = Deformation::none(Points<3>::Random(3, 20), expected.history_size());
  at.dt = 1e-3;
  at.heat = Vector::Constant(20, 0.1);
  for (int k = 0; k < 2; ++k) {
    at.F += 0.02 * Tensors::Random(9, 20);
    const MaterialResponse a = respond(*found, at, false), b = respond(expected, at, false);
    EXPECT_EQ(a.P, b.P);
    EXPECT_EQ(a.history, b.history);
    at.history = b.history;
  }
  EXPECT_GT(at.history.cwiseAbs().maxCoeff(), 0.0);
}

TEST(MaterialReader, KnowsLinearHardeningAndLudwiksLawInAnExpression) {
  const auto metal = [](const std::string& yield) {
    return read("model = \"j2\"\nE = 70e3\nnu = 0.33\nstrain = \"finite\"\nyield = \"" + yield + "\"\n");
  };
  const auto expected = [](const Hardening& yield) {
    return J2({.moduli = {.E = 70e3, .nu = 0.33}, .yield = yield, .strain = Strain::finite});
  };
  expect_same(metal("120 + 4.5e2*a"), expected(Hardening::linear(120.0, 450.0)));
  expect_same(metal(" 120+400 * a^.4 "), expected(Hardening::ludwik(120.0, 400.0, 0.4)));
  // What is more than that is an expression, with the same stresses.
  Deformation at = Deformation::none(Points<3>::Random(3, 20), 7);
  at.F += 0.02 * Tensors::Random(9, 20);
  const MaterialResponse known = respond(*metal("120 + 400*a^0.4"), at, false),
                         other = respond(*metal("120 + 400*a^(0.4)"), at, false);
  EXPECT_NE(known.P, other.P) << "slopes by differences";
  EXPECT_LT((known.P - other.P).cwiseAbs().maxCoeff(), 1e-8);
}

TEST(MaterialReader, ReadsMetalsThatHeatAndHardenWithTheRate) {
  const std::string copper = "model = \"johnson_cook\"\nE = 124e3\nnu = 0.34\nA = 90\nB = 292\nn = 0.31\n";
  J2Parameters expected{
      .moduli = {.E = 124e3, .nu = 0.34}, .yield = Hardening::ludwik(90.0, 292.0, 0.31), .strain = Strain::finite};
  expect_same(read(copper), J2(expected));
  expected.rate = RateFactor::johnson_cook(0.025, 2.0);
  expect_same(read(copper + "C = 0.025\nreference_rate = 2\n"), J2(expected));
  expected.heating = Heating{
      .capacity = 3.4, .melting = 1356.0, .reference = 298.0, .exponent = 1.09, .fraction = 1.0, .initial = 400.0};
  const std::string hot = copper +
                          "C = 0.025\nreference_rate = 2\nheat_capacity = 3.4\nmelting_temperature = 1356\n"
                          "reference_temperature = 298\ninitial_temperature = 400\nm = 1.09\ntaylor_quinney = 1\n";
  expect_same(read(hot), J2(expected));
  expect_same(read(hot + "density = 8.93e-9\nsound_speed = 3.94e6\nslope = 1.489\ngamma = 1.99\n"),
              WithPressure(J2(expected), EquationOfState::mie_grueneisen({8.93e-9, 3.94e6, 1.489, 1.99})));
  expect_same(read("model = \"j2\"\nE = 210e3\nnu = 0.3\nyield = 300\nD = 40.4\nq = 5\nstrain = \"finite\"\n"),
              J2({.moduli = {.E = 210e3, .nu = 0.3},
                  .yield = 300.0,
                  .strain = Strain::finite,
                  .rate = RateFactor::cowper_symonds(40.4, 5.0)}));
}

TEST(MaterialReader, ReadsTablesOfHardeningAndOfTheRateForBothMetals) {
  const std::string rate = "rate_factor = [[0.1, 0.9], [10, 1], [1e4, 1.6]]\n";
  const RateFactor factor = RateFactor::table({0.1, 10.0, 1e4}, {0.9, 1.0, 1.6});
  J2Parameters expected{.moduli = {.E = 210e3, .nu = 0.3},
                        .yield = Hardening::table({0.0, 0.01, 0.2}, {300.0, 350.0, 500.0}),
                        .strain = Strain::finite,
                        .rate = factor};
  const std::string steel =
      "model = \"j2\"\nE = 210e3\nnu = 0.3\nstrain = \"finite\"\nyield = [[0, 300], [0.01, 350], [0.2, 500]]\n";
  expect_same(read(steel + rate), J2(expected));
  expected.rate = RateFactor::johnson_cook(0.02, 1.0);
  expect_same(read(steel + "C = 0.02\nreference_rate = 1\n"), J2(expected));
  expected.yield = Hardening::ludwik(300.0, 200.0, 0.5);
  const std::string other = "model = \"johnson_cook\"\nE = 210e3\nnu = 0.3\nA = 300\nB = 200\nn = 0.5\n";
  expected.rate = factor;
  expect_same(read(other + rate), J2(expected));
  expected.rate = RateFactor::cowper_symonds(40.4, 5.0);
  expect_same(read(other + "D = 40.4\nq = 5\n"), J2(expected));
}

TEST(MaterialReader, ReadsTheStrengthOfAnyMaterialBesideThatOfRankine) {
  const auto strength = [](const std::string& text) {
    const toml::table table = toml::parse("[material]\nE = 1\nnu = 0.3\n" + text, std::string_view("case.toml"));
    CommonSettings<2> settings;
    const Expressions<2> expressions;
    internal::MaterialReader<2>(expressions).read(internal::Section(table, "", "case.toml", {}), settings);
    return settings.strength;
  };
  EXPECT_FALSE(strength("").is_given());
  EXPECT_EQ(strength("strength = { yield = 250 }").yield, 250.0);
  EXPECT_EQ(strength("strength = { yield = 250 }").ultimate, 0.0);
  EXPECT_EQ(strength("model = \"hencky\"\nstrength = { ultimate = 400 }").ultimate, 400.0);
  EXPECT_FALSE(strength("model = \"rankine\"\nstrength = 2").is_given());
}

TEST(MaterialReader, ReadsFluids) {
  expect_same(
      read("model = \"ideal_gas\"\ngamma = 1.4\npressure = \"1 + x^2\"\n"),
      Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = [](const Vec<3>& X) { return 1.0 + X[0] * X[0]; }}));
  expect_same(read("model = \"stiffened_gas\"\ngamma = 4.4\nstiffening = 6\nviscosity = 0.2\n"),
              Fluid({.state = EquationOfState::stiffened_gas(4.4, 6.0), .viscosity = 0.2}));
  expect_same(read("model = \"tait\"\nkappa = 2.2\nexponent = 7\npressure = 0.1\nbulk_viscosity = 0.3\n"),
              Fluid({.state = EquationOfState::tait(2.2, 7.0), .pressure = 0.1, .bulk_viscosity = 0.3}));
  expect_same(read("model = \"mie_grueneisen\"\ndensity = 8.93\nsound_speed = 3.94\nslope = 1.489\ngamma = 1.99\n"),
              Fluid({.state = EquationOfState::mie_grueneisen({8.93, 3.94, 1.489, 1.99})}));
}

TEST(MaterialReader, RefusesWhatMakesNoSenseWithItsLine) {
  const auto refuses = [](const std::string& text, const char* part) {
    EXPECT_THAT([&] { read(text); }, ::testing::ThrowsMessage<InputError>(HasSubstr(part))) << text;
  };
  const std::string metal = "model = \"johnson_cook\"\nE = 1\nnu = 0.3\nA = 1\n";
  refuses(metal + "C = 0.1", "key \"reference_rate\" is missing");
  refuses(metal + "reference_rate = 1", "case.toml:6: reference_rate is given without C");
  refuses(metal + "m = 1", "case.toml:6: m is given without a heat_capacity");
  refuses(metal + "heat_capacity = 1", "key \"melting_temperature\" is missing");
  refuses(metal + "heat_capacity = 1\nmelting_temperature = 3\nreference_temperature = 4",
          "melting temperature = 3, expected more than the reference");
  refuses(metal + "gamma = 1", "case.toml:6: gamma is given without a sound_speed");
  refuses(metal + "strain = \"small\"\ndensity = 1\nsound_speed = 1\nslope = 1\ngamma = 1",
          "case.toml:6: strain is \"small\", and the equation of state");
  refuses(metal + "yield = 1", "case.toml:6: yield means nothing for model = \"johnson_cook\"");
  refuses("model = \"j2\"\nE = 1\nnu = 0.3\nyield = 1\nq = 5", "case.toml:6: q is given without D");
  refuses(metal + "C = 0.1\nreference_rate = 1\nrate_factor = [[1, 1]]",
          "case.toml:8: C and rate_factor are two laws of the rate of strain");
  refuses(metal + "rate_factor = [[10, 1], [1, 2]]",
          "case.toml:6: rate_factor: rate of strain 1 of a table after 10, expected ascending values");
  refuses(metal + "rate_factor = [[1, 1], [10, 0.5]]",
          "case.toml:6: rate_factor: factor of a rate of strain = 0.5, expected positive factors that do not fall");
  refuses(metal + "rate_factor = 2", "case.toml:6: rate_factor is 2, expected an array of pairs of numbers");
  const std::string elastic = "E = 1\nnu = 0.3\n";
  refuses(elastic + "strength = 3", "case.toml:4: strength is 3, expected a table [material.strength]");
  refuses(elastic + "strength = {}", "case.toml:4: strength is empty, expected yield, ultimate or both");
  refuses(elastic + "strength = { yield = 0 }", "case.toml:4: yield is 0, expected a number > 0");
  refuses(elastic + "strength = { yeild = 1 }", "unknown key \"yeild\"");
  refuses("model = \"rankine\"\n" + elastic + "strength = { yield = 1 }", "case.toml:5: strength is a table");
  refuses("model = \"j2\"\nE = 1\nnu = 0.3\nyield = [[0, 1], [0.2, 2], [0.1, 3]]",
          "case.toml:5: yield: plastic strain 0.1 of a table after 0.2, expected ascending values");
  refuses("model = \"ideal_gas\"\ngamma = 1.4", "key \"pressure\" is missing");
  refuses("model = \"ideal_gas\"\ngamma = 1\npressure = 1", "case.toml:3: gamma is 1, expected a number > 1");
  refuses("model = \"ideal_gas\"\ngamma = 1.4\npressure = -1", "case.toml:4: pressure is -1, expected a number > 0");
  refuses("model = \"tait\"\nkappa = 1\nexponent = 0", "case.toml:4: exponent is 0");
  refuses("model = \"mie_grueneisen\"\nsound_speed = 1\nslope = 1\ngamma = 1", "key \"density\" is missing");
}

}  // namespace
}  // namespace efree
