// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of smoothed particles: errors of input, results of runs.
#include "efree/tests/io/dynamics_cases.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <string>
#include <variant>

namespace efree {
namespace {

using test::json, test::refuses, test::replaced, test::says, test::Workspace;
namespace fs = std::filesystem;

/// A block of dry sand that loses its wall.
const std::string sand = R"toml(title = "sand"
[geometry]
shape = "rectangle"
parameters = { width = 0.2, height = 0.1 }
mesh_size = 0.1
[analysis]
kind = "dynamics"
plane = "strain"
gravity = [0, -9.81]
[sph]
spacing = 0.01
[material]
model = "drucker_prager"
E = 1e6
nu = 0.3
cohesion = 0
friction = 30
dilatancy = 0
fit = "plane_strain"
density = 2000
[[wall]]
normal = [0, 1]
friction = "stick"
[[wall]]
normal = [1, 0]
[[probe]]
name = "toe"
largest = "x"
[[probe]]
name = "toe of most"
largest = "x"
share = 0.9
[[probe]]
name = "speed"
largest = "speed"
share = 0.5
[time]
end = 0.2
[output]
frames = 2
)toml";

std::string with(const std::string& more) {
  return replaced(sand, "spacing = 0.01\n", "spacing = 0.01\n" + more + "\n");
}

TEST(SphCase, WrongInputIsRefusedWithFileAndLine) {
  EXPECT_THAT(refuses(replaced(sand, "spacing = 0.01\n", "")), says("key \"spacing\" is missing in [sph]"));
  EXPECT_THAT(refuses(replaced(sand, "spacing = 0.01\n", "spacing = 0.05\n")), says("Expected a tenth of that"));
  EXPECT_THAT(refuses(with("smoothing = 0.5")), says("smoothing"));
  EXPECT_THAT(refuses(with("kernel = \"gauss\"")), says("wendland_c2"));
  EXPECT_THAT(refuses(with("viscosity = { linear = -1 }")), says("linear"));
  EXPECT_THAT(refuses(with("splitting = { levels = 2 }")), says("strain"));
  EXPECT_THAT(refuses(with("splitting = { strain = 0.1, separation = 1 }")), says("separation"));
  EXPECT_THAT(refuses(with("frame = \"total\"\ncorrected = false")), says("means nothing with frame = \"total\""));
  EXPECT_THAT(refuses(replaced(sand, "plane = \"strain\"", "plane = \"axisymmetric\"")),
              says("not of an axisymmetric section"));
  EXPECT_THAT(refuses(sand + "[mpm]\ncell = 0.02\n"), says("[sph] has options of the method \"sph\""));
  EXPECT_THAT(refuses(sand + "[cloud]\nspacing = 0.02\n"), says("[sph] has options of the method \"sph\""));
  EXPECT_THAT(refuses(sand + "[cloud]\nspacing = 0.02\n[dynamics]\nmethod = \"sph\"\n"), says("leave out [cloud]"));
  EXPECT_THAT(refuses(sand + "[otm]\ngamma = 2\n"), says("leave out [otm]"));
  EXPECT_THAT(refuses(replaced(sand, "E = 1e6\n", "")), says("nu given, expected two"));
  EXPECT_THAT(refuses(replaced(sand, "dilatancy = 0", "dilatancy = 31")), says("no more than the friction of 30"));
  EXPECT_THAT(refuses(replaced(sand, "friction = 30", "friction = 0")), says("cohesion is 0, expected a number > 0"));
  EXPECT_THAT(refuses(replaced(sand, "share = 0.9", "share = 0")), says("share"));
}

TEST(SphRun, AHeapHasItsToeAndComesToRest) {
  for (const char* more : {"", "splitting = { strain = 0.1 }", "kernel = \"wendland_c2\"\nsmoothing = 1.5"}) {
    const Workspace workspace(with(more));
    const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet"});
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
    const double toe = result["probes"]["toe"].get<double>(), most = result["probes"]["toe of most"].get<double>();
    EXPECT_GT(most, 0.2);
    EXPECT_GT(toe, most);
    EXPECT_LT(toe, 0.4);
    EXPECT_LT(result["probes"]["speed"].get<double>(), result["extremes"]["speed"]["max"]["value"].get<double>());
    EXPECT_GT(fs::file_size(workspace / "out/frame_0002.png"), 1000u);
    if (std::string(more).starts_with("splitting"))
      EXPECT_GT(result["counts"]["split_particles"].get<int>(), 20);
    else
      EXPECT_FALSE(result["counts"].contains("split_particles"));
  }
}

TEST(SphRun, PartsOfTheBoundaryTakeParticlesAlong) {
  for (const char* frame : {"updated", "total"}) {
    const Workspace workspace(
        replaced(replaced(with(std::string("frame = \"") + frame + "\""), "cohesion = 0\n", "cohesion = 1e6\n"),
                 "end = 0.2", "end = 0.01") +
        "[[boundary]]\non = \"right\"\nvelocity = [0.2, 0]\n");
    const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet"});
    ASSERT_EQ(done.status, 0) << done.output;
    EXPECT_NEAR(json(workspace / "out/result.json")["probes"]["toe"].get<double>(), 0.202, 1e-4) << frame;
  }
}

template <int Dim> void expect_that_example_begins(const std::string& name) {
  const auto any = read_case(fs::path(EFREE_EXAMPLES) / "sph" / (name + ".toml"));
  auto model = build_dynamics_model(std::get<DynamicsCase<Dim>>(any));
  for (int k = 0; k < 10; ++k) model.dynamics.step();
  EXPECT_LT(std::abs(model.dynamics.energy().error()), 1e-2) << name;
}

TEST(SphRun, ExamplesBegin) {
  for (const char* name : {"rods", "cut", "landslide"}) expect_that_example_begins<2>(name);
  expect_that_example_begins<3>("valley");
}

TEST(SphRun, RubberThatTearsNumericallyUnderTensionIsWarnedOf) {
  const Workspace workspace(replaced(replaced(test::rubber, "[material]", "[sph]\nspacing = 0.1\n[material]"),
                                     "value = [0, \"-0.2\"]", "value = [\"0.4*(x - 1)\", 0]"));
  const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet", "--no-picture"});
  EXPECT_EQ(done.status, 0) << done.output;
  EXPECT_NE(done.output.find("tensile instability"), std::string::npos) << done.output;
}

TEST(SphRun, MeanForceOnARigidBodyIsTheWeightThatRestsOnItOnceItDoes) {
  // An elastic block with much viscosity is let down on a plane within 0.2 s; on the mean of 2 s it weighs what it
  // does.
  const Workspace workspace(
      replaced(replaced(replaced(with("viscosity = { linear = 1 }"), "cohesion = 0\n", "cohesion = 1e6\n"),
                        "[[wall]]\nnormal = [0, 1]\nfriction = \"stick\"\n",
                        "[[rigid_body]]\nshape = \"plane\"\nnormal = [0, 1]\n"
                        "[[probe]]\nname = \"weight\"\nmean_force = "
                        "\"rigid_body.0.force.y\"\ntruth = -392.4\n"),
               "end = 0.2", "end = 2"));
  const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet", "--no-picture"});
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_NEAR(json(workspace / "out/result.json")["probes"]["weight"].get<double>(), -392.4, 4.0);
}

TEST(SphRun, WrongHeightsAndMeanForcesAreNamed) {
  const auto probe = [](const std::string& text) { return refuses(sand + "[[probe]]\nname = \"F\"\n" + text); };
  EXPECT_THAT(probe("mean_force = \"rigid_body.0.force.y\"\n"), says("no [[rigid_body]]"));
  const std::string plane = "[[rigid_body]]\nshape = \"plane\"\nnormal = [0, 1]\nlevel = -1\n";
  const auto of_plane = [&](const std::string& text) {
    return refuses(sand + plane + "[[probe]]\nname = \"F\"\n" + text);
  };
  EXPECT_THAT(of_plane("mean_force = \"rigid_body.1.force.y\"\n"), says("rigid_body.0.force.x"));
  EXPECT_THAT(of_plane("mean_force = \"rigid_body.0.force.y\"\nshare = 0.5\n"), says("share means nothing"));
  EXPECT_THAT(refuses(sand + "[[rigid_body]]\nshape = \"heights\"\nfile = \"valley.pgm\"\n"), says("polygon"));
  std::string block = sand;
  for (const auto& [from, to] :
       {std::pair("rectangle", "box"), std::pair("height = 0.1", "depth = 0.1, height = 0.1"),
        std::pair("plane = \"strain\"\n", ""), std::pair("[0, -9.81]", "[0, 0, -9.81]"),
        std::pair("plane_strain", "compression"), std::pair("[0, 1]", "[0, 0, 1]"), std::pair("[1, 0]", "[1, 0, 0]")})
    block = replaced(block, from, to);
  const auto in_space = [&](const std::string& heights) {
    return refuses(block + "[[rigid_body]]\nshape = \"heights\"\n" + heights);
  };
  EXPECT_THAT(in_space("spacing = 1\n"), says("file"));
  EXPECT_THAT(in_space("file = \"nowhere.png\"\n"), says("nowhere.png"));
  EXPECT_THAT(in_space("file = \"case.toml\"\n"), says("case.toml"));
  EXPECT_THAT(in_space("file = \"nowhere.png\"\nspacing = [1, 2, 3]\n"), says("expected one or 2"));
  EXPECT_THAT(in_space("file = \"nowhere.png\"\nradius = 1\n"), says("radius means nothing"));
}

}  // namespace
}  // namespace efree
