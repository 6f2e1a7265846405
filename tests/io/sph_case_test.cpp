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

TEST(SphRun, ExamplesBegin) {
  for (const char* name : {"rods", "cut", "landslide"}) {
    const auto any = read_case(fs::path(EFREE_EXAMPLES) / "sph" / (std::string(name) + ".toml"));
    const auto& example = std::get<DynamicsCase<2>>(any);
    auto model = build_dynamics_model(example);
    for (int k = 0; k < 10; ++k) model.dynamics.step();
    EXPECT_LT(std::abs(model.dynamics.energy().error()), 1e-2) << name;
  }
}

}  // namespace
}  // namespace efree
