// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"
#include "efree/core/error.hpp"
#include "workspace.hpp"

#include <regex>

namespace efree {
namespace {

using test::replaced;
using test::strip_case;
using test::Workspace;

/// What is wrong with the case, without the folder's name.
std::string complaint(const Workspace& work) {
  try {
    read_case(work / "case.toml");
  } catch (const InputError& error) {
    return std::regex_replace(error.what(), std::regex((work / "").string()), "");
  }
  return "no error";
}
std::string complaint(const std::string& text) {
  return complaint(Workspace(text));
}

Case<2> planar(const Workspace& work) {
  return std::get<Case<2>>(read_case(work / "case.toml"));
}

struct Wrong {
  const char* from;
  const char* to;
  const char* message;  ///< regular expression
};

class WrongCase : public testing::TestWithParam<Wrong> {};

TEST_P(WrongCase, IsRefusedWithFileAndLine) {
  const Wrong& wrong = GetParam();
  const std::string message = complaint(replaced(strip_case, wrong.from, wrong.to));
  EXPECT_TRUE(std::regex_search(message, std::regex(wrong.message))) << message;
}

TEST(CaseFile, NamesLongerThanFilesCanHaveAreOfNoFile) {
  const std::string message = complaint(
      replaced(strip_case, "file = \"strip.geo\"", ("file = \"" + std::string(5000, 'x') + ".geo\"").c_str()));
  EXPECT_TRUE(message.starts_with("case.toml:3: there is no file xxx")) << message.substr(0, 200);
}

INSTANTIATE_TEST_SUITE_P(
    Keys, WrongCase,
    testing::Values(
        Wrong{"spacing = 0.4", "spacng = 0.4",
              R"(^case.toml:6: unknown key "spacng" in \[cloud\]; did you mean "spacing"\?)"},
        Wrong{"[quadrature]", "[qadrature]", R"(^case.toml:8: unknown key "qadrature"; did you mean "quadrature"\?)"},
        Wrong{
            "E = 1.0", "colour = 1.0",
            R"(^case.toml:16: unknown key "colour" in \[material\]; expected one of model, density, conductivity, E, nu)"},
        Wrong{"seed = 1", "seed = 1\nseed = 2", R"(^case.toml:8: )"},
        Wrong{"E = 1.0", "", R"(^case.toml:15: key "E" is missing in \[material\])"},
        Wrong{"plane = \"stress\"", "", R"(^case.toml:13: key "plane" is missing in \[analysis\])"},
        Wrong{"[material]\nE = 1.0\nnu = 0.3", "", R"(^case.toml: section \[material\] is missing)"},
        Wrong{"file = \"strip.geo\"", "file = \"stripe.geo\"", R"(^case.toml:3: there is no file stripe.geo)"},
        Wrong{"[geometry]", "[geometry", R"(^case.toml:2: )"}));

INSTANTIATE_TEST_SUITE_P(
    Values, WrongCase,
    testing::Values(
        Wrong{"nu = 0.3", "nu = 0.5", R"(^case.toml:17: nu is 0.5, expected a number in \(-1, 0.5\))"},
        Wrong{"nu = 0.3", "nu = -1", R"(^case.toml:17: nu is -1, expected)"},
        Wrong{"E = 1.0", "E = 0", R"(^case.toml:16: E is 0, expected a number > 0)"},
        Wrong{"E = 1.0", "E = nan", R"(^case.toml:16: E is nan, expected a number > 0)"},
        Wrong{"E = 1.0", "E = \"1 +\"", R"(^case.toml:16: expression "1 \+", position)"},
        Wrong{"E = 1.0", "E = \"-1\"", R"(^case.toml:16: E is -1, expected a number > 0)"},
        Wrong{"E = 1.0", "E = [1, 2, 3]", R"(^case.toml:16: E is an array of 3, expected a number > 0)"},
        Wrong{"E = 1.0\nnu = 0.3", "model = \"tait\"\nkappa = 1\nexponent = 7",
              R"(^case.toml:15: a fluid bears no load at rest)"},
        Wrong{"nu = 0.3", "nu = 0.3\nG = [1, 1, 1]",
              R"(^case.toml:18: G means nothing for model = "linear_elastic", which has E, nu)"},
        Wrong{"E = 1.0\nnu = 0.3", "model = \"orthotropic\"\nE = [1, 1]\nnu = [0, 0, 0]\nG = [1, 1, 1]",
              R"(^case.toml:17: E has 2 numbers, expected 3)"},
        Wrong{"E = 1.0\nnu = 0.3", "model = \"orthotropic\"\nE = [1, 1, 1]\nnu = [0, 0, 2]\nG = [1, 1, 1]",
              R"(^case.toml:18: .*indefinite)"},
        Wrong{"order = 1", "order = 3", R"(^case.toml:12: order is 3, expected an integer from 1 to 2)"},
        Wrong{"order = 1", "order = 1.5", R"(^case.toml:12: order is 1.5, expected an integer)"},
        Wrong{"seed = 1", "seed = -1", R"(^case.toml:7: seed is -1, expected an integer >= 0)"},
        Wrong{"plane = \"stress\"", "plane = \"shell\"",
              R"(^case.toml:14: plane is "shell", expected "stress" or "strain")"},
        Wrong{"mesh_size = 0.1", "mesh_size = 0.1\nmesh_ratio = 4", R"(^case.toml:5: mesh_size and mesh_ratio)"},
        Wrong{"basis = \"cells\"", "dilatation = 1",
              R"(^case.toml:9: dilatation is 1, expected true, false or "auto")"},
        Wrong{"at = [2.0, 0.5]", "at = [2.0]", R"(^case.toml:32: at is an array of 1, expected an array of 2 numbers)"},
        Wrong{"on = \"right\"", "on = \"\"", R"(^case.toml:25: on is '', expected a non-empty string)"},
        Wrong{"seed = 1", "support = 0.5", R"(^case.toml:7: support is 0.5, expected a number in \[1, 10\])"},
        Wrong{"[quadrature]\nbasis = \"cells\"", "quadrature = 2", R"(^case.toml:8: )"}));

INSTANTIATE_TEST_SUITE_P(
    Boundaries, WrongCase,
    testing::Values(
        Wrong{"traction = [\"1\", \"0\"]", "traction = [\"1 +\", \"0\"]",
              R"(^case.toml:26: expression "1 \+", position)"},
        Wrong{"traction = [\"1\", \"0\"]", "traction = [\"1/0\", \"0\"]", R"(^case.toml:26: expression "1/0" is inf)"},
        Wrong{"traction = [\"1\", \"0\"]", "traction = [1]",
              R"(^case.toml:26: traction is an array of 1, expected an array of 2)"},
        Wrong{"traction = [\"1\", \"0\"]", "",
              R"(^case.toml:25: a \[\[boundary\]\] entry prescribes exactly one of .* has none)"},
        Wrong{"traction = [\"1\", \"0\"]", "traction = [1, 0]\ndisplacement = [1, 0]",
              R"(^case.toml:25: .*exactly one of .*displacement and traction)"},
        Wrong{"displacement = [0, \"free\"]", "displacement = [\"free\", \"free\"]",
              R"(^case.toml:20: displacement leaves every)"},
        Wrong{"on = \"right\"\ntraction = [\"1\", \"0\"]", "on = \"left\"\ndisplacement = [1, 0]",
              R"(^case.toml:26: displacement component x on "left" is already prescribed at case.toml:20)"},
        Wrong{
            "on = \"right\"\ntraction = [\"1\", \"0\"]", "on = \"left\"\ntraction = [\"y\", 0]",
            R"(^case.toml:26: traction on "left" contradicts the displacement component x prescribed at case.toml:20)"},
        Wrong{"on = \"right\"\ntraction = [\"1\", \"0\"]", "on = \"left\"\nnormal_displacement = 0",
              R"(^case.toml:26: normal_displacement on "left" contradicts the displacement component x)"},
        Wrong{"on = \"left\"\ndisplacement = [0, \"free\"]",
              "on = \"right\"\nnormal_displacement = 0\n[[boundary]]\non = \"right\"\npressure = 1",
              R"(^case.toml:23: pressure on "right" contradicts the normal displacement prescribed at case.toml:20)"},
        Wrong{
            "on = \"left\"\ndisplacement = [0, \"free\"]",
            "on = \"left\"\npressure = 1\n[[boundary]]\non = \"left\"\ndisplacement = [0, 0]",
            R"(^case.toml:20: pressure on "left" contradicts the displacement component y prescribed at case.toml:23)"},
        Wrong{"[exact]\ndisplacement = [\"x\", \"-0.3*y\"]\nstress = [1, 0, 0]", "[exact]",
              R"(^case.toml:27: \[exact\] is empty)"}));

TEST(CaseFile, ReadsWhatIsThereAndKeepsDefaultsElsewhere) {
  const Workspace work;
  const Case<2> strip = planar(work);
  EXPECT_EQ(strip.common.title, "strip");
  EXPECT_EQ(strip.geometry.size, 0.1);
  EXPECT_EQ(strip.common.approximation.spacing, 0.4);
  EXPECT_EQ(strip.common.approximation.weight, ApproximationOptions{}.weight);
  const Settings<2> decided = with_defaults<2>(strip, prepare(strip));
  EXPECT_EQ(decided.common.model.essential, Essential::nitsche);
  EXPECT_EQ(decided.common.approximation.dilatation, Dilatation::pointwise);
  ASSERT_EQ(strip.supports.size(), 2u);
  EXPECT_TRUE(strip.supports[0].components[0]);
  EXPECT_FALSE(strip.supports[0].components[1]);
  EXPECT_EQ(strip.exact.displacement(Vec<2>(1, 2)), Vec<2>(1, -0.6));
}

TEST(CaseFile, LoadsMayActAlongASlidingPlane) {
  const std::string on_right = "on = \"right\"\ntraction = [\"1\", \"0\"]";
  EXPECT_EQ(complaint(replaced(strip_case, on_right, "on = \"left\"\ntraction = [0, 1]")), "no error");
  EXPECT_EQ(complaint(replaced(strip_case, on_right, "on = \"left\"\npressure = 1")), "no error");
}

TEST(CaseFile, SaysThatItIsEmptyOrADirectory) {
  EXPECT_EQ(complaint(""), "case.toml: section [geometry] is missing");
  const Workspace work;
  std::filesystem::remove(work / "case.toml");
  std::filesystem::create_directory(work / "case.toml");
  EXPECT_EQ(complaint(work), "case.toml is a directory, expected a case file");
}

TEST(CaseFile, BothEndsOfTheRangeOfSupportsBelongToIt) {
  for (const double support : {1.0, 10.0}) {
    const Workspace work(replaced(strip_case, "seed = 1", "support = " + std::to_string(support)));
    EXPECT_EQ(planar(work).common.approximation.support, support);
  }
}

TEST(CaseFile, OnlyAFewKeysAreRequired) {
  const Workspace work(R"([geometry]
file = "strip.geo"
[cloud]
spacing = 0.4
[analysis]
plane = "stress"
[material]
E = 1
nu = 0
[[boundary]]
on = "left"
displacement = [0, 0]
)");
  EXPECT_EQ(planar(work).common.title, "case");
}

TEST(CaseFile, DilatationIsAveragedWherePlaneStrainWouldLock) {
  const auto dilatation = [](const char* plane, const char* nu, const char* kind, const char* choice) {
    std::string text = replaced(strip_case, "\"stress\"", std::string("\"") + plane + "\"");
    text = replaced(text, "nu = 0.3", std::string("nu = ") + nu);
    text = replaced(text, "kind = \"mls\"", std::string("kind = \"") + kind + "\"");
    const Workspace work(replaced(text, "basis = \"cells\"", std::string("dilatation = ") + choice));
    const Case<2> strip = planar(work);
    return with_defaults<2>(strip, prepare(strip)).common.approximation.dilatation == Dilatation::averaged;
  };
  EXPECT_TRUE(dilatation("strain", "0.49", "mls", "\"auto\""));
  EXPECT_FALSE(dilatation("strain", "0.3", "mls", "\"auto\""));
  EXPECT_FALSE(dilatation("stress", "0.49", "mls", "\"auto\""));
  EXPECT_FALSE(dilatation("strain", "0.4999", "p1", "\"auto\""));
  EXPECT_FALSE(dilatation("strain", "0.48", "p2", "\"auto\""));
  EXPECT_TRUE(dilatation("strain", "0.495", "p2", "\"auto\""));
  EXPECT_TRUE(dilatation("strain", "\"0.3 + 0.08*x\"", "mls", "\"auto\""));  // x up to 2
  EXPECT_FALSE(dilatation("strain", "\"0.3 + 0.04*x\"", "mls", "\"auto\""));
  EXPECT_FALSE(dilatation("strain", "0.49", "mls", "false"));
  EXPECT_TRUE(dilatation("strain", "0.3", "mls", "true"));
}

TEST(CaseFile, StrongConditionsLetOtherFunctionsVanishOnTheSupports) {
  const Workspace work(replaced(strip_case, "plane = \"stress\"", "plane = \"stress\"\nessential = \"strong\""));
  const Case<2> strip = planar(work);
  EXPECT_EQ(with_defaults<2>(strip, prepare(strip)).common.approximation.vanish_on,
            (std::vector<std::string>{"left", "bottom"}));
}

}  // namespace
}  // namespace efree
