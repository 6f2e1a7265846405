// SPDX-License-Identifier: GPL-3.0-or-later
/// Cases that say how much of their materials is to be modelled: analysis.model.
#include "efree/tests/io/workspace.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using test::json, test::replaced, test::Workspace;
using ::testing::HasSubstr;
using ::testing::Not;

/// A strip that is pulled, free across.
const std::string strip = R"([geometry]
file = "strip.geo"
mesh_size = 0.2
[cloud]
spacing = 0.4
[analysis]
plane = "strain"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
displacement = [0.002, "free"]
[[probe]]
name = "end"
at = [2, 1]
)";
std::string with(const std::string& line, const std::string& text = strip) {
  return replaced(text, "plane = \"strain\"", "plane = \"strain\"\n" + line);
}
const auto solved = [](const std::string& text) {
  const Workspace work(text);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 0) << run.output;
  return std::pair(json(work / "out/result.json"), run.output);
};

TEST(ModelCase, SmallStrainsAreALinearAnalysisWithItsErrorAndSayWhy) {
  const auto [result, said] = solved(strip);
  EXPECT_THAT(said, HasSubstr("model: linear elasticity is enough, off by"));
  EXPECT_EQ(result["model"]["taken"], "linear");
  EXPECT_FALSE(result.contains("path"));
  EXPECT_LT(result["estimates"]["energy"]["total"].get<double>(), 1e-6);
  ASSERT_EQ(result["model"]["checks"].size(), 1u);
  const auto& check = result["model"]["checks"][0];
  EXPECT_EQ(check["linear"], true);
  EXPECT_NEAR(check["strain"].get<double>(), 0.001, 1e-4);
  EXPECT_LT(check["stress"].get<double>(), 0.005);
  EXPECT_GT(check["stress"].get<double>(), 0.0005) << "of the order of the strain";
  EXPECT_EQ(result["model"]["tolerance"], 0.01);
  const auto [linear, nothing_said] = solved(with("model = \"linear\""));
  EXPECT_EQ(linear["probes"], result["probes"]);
  EXPECT_EQ(linear["strain_energy"], result["strain_energy"]);
  EXPECT_FALSE(linear["model"].contains("checks"));
  EXPECT_THAT(nothing_said, Not(HasSubstr("model:")));
}

TEST(ModelCase, WhatLinearElasticityWouldBeOffByIsTooMuchForTheTolerance) {
  const auto [finite, said] = solved(with("model_tolerance = 1e-4"));
  EXPECT_EQ(finite["model"]["taken"], "finite");
  EXPECT_THAT(said, HasSubstr("model: linear elasticity is not enough, off by"));
  EXPECT_TRUE(finite.contains("path"));
  const auto [full, nothing_said] = solved(with("model = \"finite\""));
  EXPECT_EQ(full["probes"], finite["probes"]);
  EXPECT_EQ(full["path"], finite["path"]);
}

TEST(ModelCase, LinearMaterialsAreAskedOnlyIfThatIsSaid) {
  const std::string elastic = replaced(replaced(strip, "model = \"neo_hookean\"\n", ""), "0.002", "0.4");
  EXPECT_EQ(solved(elastic).first["model"]["taken"], "linear");
  const auto finite = solved(with("model = \"auto\"", elastic)).first;
  EXPECT_EQ(finite["model"]["taken"], "finite");
  const auto kirchhoff =
      solved(with("model = \"finite\"", replaced(elastic, "E = 1", "model = \"st_venant_kirchhoff\"\nE = 1"))).first;
  EXPECT_NEAR(finite["probes"]["end"]["displacement"][1].get<double>(),
              kirchhoff["probes"]["end"]["displacement"][1].get<double>(), 1e-10);
}

TEST(ModelCase, AMetalThatIsFiniteHasFiniteStrains) {
  const std::string metal = replaced(replaced(strip, "neo_hookean", "j2"), "nu = 0.3", "nu = 0.3\nyield = 0.1");
  EXPECT_EQ(solved(metal).first["model"]["checks"][0]["same"], true) << "small strains that do not flow";
  const auto check = solved(with("model = \"auto\"", replaced(metal, "0.3\ny", "0.3\nstrain = \"finite\"\ny")))
                         .first["model"]["checks"][0];
  EXPECT_EQ(check["same"], false);
  EXPECT_EQ(check["linear"], true);
  const auto said = solved(with("model = \"finite\"", replaced(metal, "0.3\ny", "0.3\nstrain = \"finite\"\ny"))).first;
  const auto left = solved(with("model = \"finite\"", metal)).first;
  EXPECT_EQ(said["probes"], left["probes"]);
}

/// The strip under a pressure on its end that follows it.
std::string pressed(const std::string& pressure) {
  return replaced(strip, "displacement = [0.002, \"free\"]", "pressure = " + pressure + "\nfollower = true");
}

TEST(ModelCase, ASmallPressureThatFollowsTheBodyIsALinearAnalysis) {
  const auto [small, said] = solved(pressed("-0.001"));
  EXPECT_EQ(small["model"]["taken"], "linear") << said;
  EXPECT_NEAR(small["probes"]["end"]["displacement"][0].get<double>(), 2.0 * 0.001 * (1.0 - 0.09), 1e-9);
  EXPECT_EQ(small["loads"][0]["kind"], "follower_pressure");
  EXPECT_NEAR(small["loads"][0]["force"][0].get<double>(), 0.001, 1e-12);
  EXPECT_LT(small["balance"]["error"].get<double>(), 1e-8);
  const auto stepped = solved(pressed("\"-0.001*t\"") + "[time]\nstep = 0.5\nmax_step = 0.5\n").first;
  EXPECT_EQ(stepped["model"]["taken"], "linear");
  EXPECT_NEAR(stepped["probes"]["end"]["displacement"][0].get<double>(), 2.0 * 0.001 * (1.0 - 0.09), 1e-9);
}

TEST(ModelCase, ALargePressureThatFollowsTheBodyTakesTheFullModel) {
  const auto [large, said] = solved(pressed("-0.3"));
  EXPECT_EQ(large["model"]["taken"], "finite") << said;
  const auto full =
      solved(replaced(pressed("-0.3"), "plane = \"strain\"", "plane = \"strain\"\nmodel = \"finite\"")).first;
  EXPECT_EQ(full["probes"], large["probes"]);
}

/// A tube of a Mooney-Rivlin rubber, bore 7 and outside 18.625, under an inner pressure of 150 (ANSYS verification
/// manual, VM56; the bore moves by 7.18): linear elasticity is far from an answer.
TEST(ModelCase, APressureFarBeyondLinearElasticityIsAnsweredWithoutTime) {
  const auto tube = solved(R"([geometry]
shape = "rectangle"
parameters = { x = 7, width = 11.625, height = 2 }
[analysis]
plane = "axisymmetric"
[material]
model = "mooney_rivlin"
c10 = 80
c01 = 20
kappa = 99990
[[boundary]]
on = "left"
pressure = 150
follower = true
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "top"
normal_displacement = 0
[[probe]]
name = "bore"
at = [7, 1]
)")
                        .first;
  EXPECT_EQ(tube["model"]["taken"], "finite");
  EXPECT_NEAR(tube["probes"]["bore"]["displacement"][0].get<double>(), 7.18, 0.07);
}

TEST(ModelCase, WhatIsWrongIsSaidWithItsPlace) {
  const auto refused = [](const std::string& text) {
    const Workspace work(text);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    EXPECT_EQ(run.status, 2) << run.output;
    return run.output;
  };
  EXPECT_THAT(refused(with("model = \"small\"")), HasSubstr("case.toml:8"));
  EXPECT_THAT(refused(with("model = \"small\"")), HasSubstr("\"finite\""));
  EXPECT_THAT(refused(with("model_tolerance = 0")), HasSubstr("model_tolerance is 0"));
  EXPECT_THAT(refused(with("model = \"finite\"\nmodel_tolerance = 0.1")), HasSubstr("model_tolerance is for"));
  EXPECT_THAT(refused(strip + "[accuracy]\nenergy = 0.01\n"), HasSubstr("analysis.model = \"linear\""));
  EXPECT_THAT(refused(strip + "[[case]]\nname = \"a\"\n"), HasSubstr("analysis.model = \"linear\""));
  const std::string metal = replaced(strip, "neo_hookean\"", "j2\"\nyield = 0.1\nstrain = \"small\"");
  EXPECT_THAT(refused(with("model = \"finite\"", metal)), HasSubstr("asks for finite strains"));
}

}  // namespace
}  // namespace efree
