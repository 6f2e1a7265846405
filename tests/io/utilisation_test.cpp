// SPDX-License-Identifier: GPL-3.0-or-later
/// Utilisation of materials in results.
#include "efree/analysis/utilisation.hpp"

#include "efree/tests/io/dynamics_cases.hpp"

#include <gmock/gmock.h>
#include <cmath>

namespace efree {
namespace {

using test::content, test::json, test::plate, test::replaced, test::rubber, test::run, test::strip_case,
    test::Workspace;
using ::testing::HasSubstr;

TEST(Utilisation, IsTheLargerOfVonMisesStressAndPrincipalStressOverTheirLimits) {
  const Voigt<2> tension = Vec<4>(3.0, 0.0, 0.0, 0.0), shear = Vec<4>(0.0, 0.0, 0.0, 2.0), pressure = -tension;
  EXPECT_DOUBLE_EQ(utilisation<2>({.yield = 4.0}, tension), 0.75);
  EXPECT_DOUBLE_EQ(utilisation<2>({.ultimate = 4.0}, tension), 0.75);
  EXPECT_DOUBLE_EQ(utilisation<2>({.yield = 4.0, .ultimate = 2.0}, tension), 1.5);
  EXPECT_DOUBLE_EQ(utilisation<2>({.yield = 4.0}, shear), 0.5 * std::sqrt(3.0));
  EXPECT_DOUBLE_EQ(utilisation<2>({.ultimate = 4.0}, shear), 0.5);
  EXPECT_DOUBLE_EQ(utilisation<2>({.yield = 4.0}, pressure), 0.75);
  EXPECT_EQ(utilisation<2>({.ultimate = 4.0}, pressure), 0.0) << "nothing is pulled";
  EXPECT_EQ(utilisation<2>({}, tension), 0.0);
  Voigt<3> solid;
  solid << 1.0, 1.0, 0.0, 0.0, 0.0, 2.0;
  EXPECT_DOUBLE_EQ(utilisation<3>({.ultimate = 6.0}, solid), 0.5);
}

TEST(Utilisation, OfAStripUnderTensionIsItsStressOverItsStrength) {
  const Workspace workspace;
  const auto done =
      run(workspace, replaced(strip_case, "nu = 0.3\n", "nu = 0.3\nstrength = { yield = 2, ultimate = 4 }\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("utilisation of \"strip\" 0.5 by yield strength at ("));
  EXPECT_THAT(done.output, HasSubstr("utilisation of \"strip\" 0.25 by ultimate strength at ("));
  EXPECT_THAT(done.output, HasSubstr("): safety factor 4"));
  const auto found = json(workspace / "out/result.json")["utilisation"];
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0]["region"], "strip");
  EXPECT_EQ(found[0]["limit"], "yield");
  EXPECT_NEAR(found[0]["value"].get<double>(), 0.5, 1e-9);
  EXPECT_NEAR(found[0]["safety_factor"].get<double>(), 2.0, 1e-8);
  EXPECT_EQ(found[0]["at"].size(), 2u);
  EXPECT_EQ(found[1]["limit"], "ultimate");
  EXPECT_NEAR(found[1]["value"].get<double>(), 0.25, 1e-9);
  EXPECT_THAT(content(workspace / "out/fields.vtu"), HasSubstr("Name=\"utilisation\""));
}

TEST(Utilisation, IsReachedWhereTheStressIsLargest) {
  const Workspace workspace;
  const auto done = run(workspace, replaced(plate, "nu = 0.3\n", "nu = 0.3\nstrength = { yield = 5 }\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_DOUBLE_EQ(result["utilisation"][0]["value"].get<double>(),
                   result["extremes"]["von_mises"]["value"].get<double>() / 5.0);
  EXPECT_EQ(result["utilisation"][0]["at"], result["extremes"]["von_mises"]["at"]);
}

/// Two squares in a row, pulled with a stress of 1.
TEST(Utilisation, IsOfEachRegionByItsOwnMaterial) {
  const Workspace workspace;
  std::ofstream(workspace / "squares.geo") << R"(SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1};
Rectangle(2) = {1, 0, 0, 1, 1};
Coherence;
Physical Surface("soft") = {1};
Physical Surface("hard") = {2};
)";
  const auto squares = [](const std::string& soft, const std::string& hard) {
    return "[geometry]\nfile = \"squares.geo\"\nmesh_size = 0.25\n[analysis]\nplane = \"stress\"\n"
           "[basis]\nkind = \"p1\"\n[[material]]\nregion = \"soft\"\nE = 1\nnu = 0\n" +
           soft + "[[material]]\nregion = \"hard\"\nE = 4\nnu = 0\n" + hard +
           "[[boundary]]\non = { box = [[0, 0], [0, 1]] }\ndisplacement = [0, 0]\n"
           "[[boundary]]\non = { box = [[2, 0], [2, 1]] }\ntraction = [1, 0]\n";
  };
  auto done = run(workspace, squares("strength = { yield = 2 }\n", "strength = { ultimate = 5 }\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  auto result = json(workspace / "out/result.json");
  ASSERT_EQ(result["utilisation"].size(), 2u);
  for (const auto& [region, value] : {std::pair{"soft", 0.5}, {"hard", 0.2}}) {
    const auto& one = result["utilisation"][region == std::string("hard") ? 0 : 1];
    EXPECT_EQ(one["region"], region);
    EXPECT_NEAR(one["value"].get<double>(), value, 1e-9);
  }
  // Of one of them only, and of none.
  done = run(workspace, squares("", "strength = { ultimate = 5 }\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  result = json(workspace / "out/result.json");
  ASSERT_EQ(result["utilisation"].size(), 1u);
  EXPECT_EQ(result["utilisation"][0]["region"], "hard");
  done = run(workspace, squares("", ""));
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_FALSE(json(workspace / "out/result.json").contains("utilisation"));
  EXPECT_THAT(content(workspace / "out/fields.vtu"), ::testing::Not(HasSubstr("utilisation")));
}

TEST(Utilisation, OfBodiesInExplicitDynamicsIsAFieldOfTheirPoints) {
  const Workspace workspace;
  const std::string text =
      replaced(replaced(rubber, "density = 1\n", "density = 1\nstrength = { yield = 0.5 }\n"), "end = 4", "end = 1") +
      "[[probe]]\nname = \"use\"\nlargest = \"utilisation\"\n";
  const auto done = run(workspace, text);
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr(" by yield strength at ("));
  const auto result = json(workspace / "out/result.json");
  ASSERT_EQ(result["utilisation"].size(), 1u);
  const double value = result["utilisation"][0]["value"].get<double>();
  EXPECT_GT(value, 0.0);
  EXPECT_DOUBLE_EQ(value, result["extremes"]["von_mises"]["max"]["value"].get<double>() / 0.5);
  EXPECT_EQ(result["utilisation"][0]["at"], result["extremes"]["von_mises"]["max"]["at"]);
  EXPECT_EQ(result["extremes"]["utilisation"]["max"]["value"].get<double>(), value);
  EXPECT_EQ(result["probes"]["use"].get<double>(), value);
  EXPECT_THAT(content(workspace / "out/points_0003.vtu"), HasSubstr("Name=\"utilisation\""));
}

}  // namespace
}  // namespace efree
