// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics from case files: mass scaling, and starts from states and stresses.
#include "efree/tests/io/dynamics_cases.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <filesystem>
#include <map>
#include <regex>

namespace efree {
namespace {

using test::column, test::content, test::json, test::refuses, test::replaced, test::rubber, test::says, test::with,
    test::without, test::Workspace;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

std::string with_time(const std::string& more) {
  return with("end = 4", "end = 4\n" + more);
}
/// A block that is pressed slowly between plates, as in `press`.
const std::string press = R"toml(title = "press"
[geometry]
shape = "rectangle"
parameters = { width = 1, height = 1 }
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1e-4
[[boundary]]
on = "bottom"
velocity = [0, 0]
[[boundary]]
on = "top"
displacement = [0, -0.1]
ramp = [[0, 0], [4, 1]]
[time]
end = 4
[output]
frames = 1
history = 50
)toml";

auto run_in(const Workspace& workspace, const std::string& text, const std::string& out) {
  workspace.write("case.toml", text);
  return workspace.efree({"run", "case.toml", "--out", out, "--threads", "1", "--no-picture"});
}

TEST(DynamicsStart, WrongMassScalingIsRefusedWithFileAndLine) {
  const auto refused = [](const std::string& table) { return refuses(with_time("mass_scaling = " + table)); };
  EXPECT_THAT(refused("{ factor = 0.5 }"), says("factor is 0.5, expected a number >= 1"));
  EXPECT_THAT(refused("{ factor = 0 }"), says("expected a number >= 1"));
  EXPECT_THAT(refused("{ factor = -3 }"), says("expected a number >= 1"));
  EXPECT_THAT(refused("{ step = 0 }"), says("step is 0, expected a number"));
  EXPECT_THAT(refused("{ step = -1 }"), says("step is -1, expected a number"));
  EXPECT_THAT(refused("{ step = 5 }"), says("step is 5, expected a number"));
  EXPECT_THAT(refused("{ }"), says("expected a factor, a step, or both"));
  EXPECT_THAT(refused("100"), says("mass_scaling"));
  EXPECT_THAT(refused("{ factors = 2 }"), says("factor"));
  EXPECT_THAT(refuses(with_time("mass_scaling = { step = 0.1 }") + "[mpm]\ncell = 0.25\n"), says("take a factor"));
  EXPECT_THAT(refuses(with_time("mass_scaling = { step = 0.1 }") + "[sph]\nspacing = 0.1\n"), says("take a factor"));
  EXPECT_THAT(refuses(with_time("mass_scaling = { factor = 2 }") + "[start]\nspin = 1\n"),
              says("leave out mass_scaling"));
}

TEST(DynamicsStart, MassScalingIsReportedWithItsError) {
  const Workspace workspace;
  const auto done =
      run_in(workspace, replaced(press, "end = 4", "end = 4\nmass_scaling = { factor = 4, step = 2e-4 }"), "out");
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("mass scaling: the body of mass 0.0001 has 0.000"));
  EXPECT_THAT(done.output, HasSubstr("mass scaling: forces are off by about"));
  const auto scaling = json(workspace / "out/result.json")["mass_scaling"];
  EXPECT_EQ(scaling["bodies"].size(), 1u);
  const auto& body = *scaling["bodies"].begin();
  EXPECT_NEAR(body["mass"].get<double>(), 1e-4, 1e-12);
  EXPECT_NEAR(body["added_percent"].get<double>(), 100.0 * body["added"].get<double>() / 1e-4, 1e-9);
  EXPECT_GE(body["added"].get<double>(), 3e-4);
  EXPECT_GT(scaling["error"].get<double>(), 0.0);
  EXPECT_LT(scaling["error"].get<double>(), 0.05);
  EXPECT_GE(scaling["kinetic_over_internal"]["largest"].get<double>(),
            scaling["kinetic_over_internal"]["median"].get<double>());
  EXPECT_TRUE(json(workspace / "out/result.json")["reports"]["warnings"].empty());
  EXPECT_NEAR(json(workspace / "out/result.json")["by_region"].begin()->at("mass").get<double>(), 1e-4, 1e-12);
  // The strip of the other case flies.
  const std::string strip = with_time("mass_scaling = { factor = 4 }");
  const auto flies = run_in(workspace, replaced(strip, "end = 4", "end = 20"), "flies");
  ASSERT_EQ(flies.status, 0) << flies.output;
  EXPECT_THAT(flies.output, AllOf(HasSubstr("warning: "), HasSubstr("inertial forces of the added mass"),
                                  HasSubstr("none where bodies fly")));
  const auto is_short = run_in(workspace, strip, "short");
  ASSERT_EQ(is_short.status, 0) << is_short.output;
  EXPECT_THAT(is_short.output, HasSubstr("the error by mass scaling is not known"));
}

TEST(DynamicsStart, AStateThatIsNotThereOrOfAnotherRunIsRefused) {
  const Workspace workspace;
  const std::string still = without("[[velocity]]\nvalue = [0, \"-0.2\"]");
  ASSERT_EQ(run_in(workspace, replaced(still, "end = 4", "end = 0.2"), "first").status, 0);
  const auto expect_refused = [&](const std::string& text, const std::string& what) {
    const auto done = run_in(workspace, text, "second");
    EXPECT_EQ(done.status, 2) << what;
    EXPECT_THAT(done.output, AllOf(HasSubstr("case.toml:"), HasSubstr(what)));
    EXPECT_THAT(done.output, Not(HasSubstr("--resume")));
  };
  const std::string start = "[start]\nstate = \"first\"\n";
  expect_refused(still + "[start]\nstate = \"nowhere\"\n", "there is no directory");
  fs::create_directory(workspace / "empty");
  expect_refused(still + "[start]\nstate = \"empty\"\n", "there is no dynamics.state in");
  expect_refused(still + "[start]\nvelocities = true\n", "velocities means nothing without a state");
  expect_refused(rubber + start, "leave out [[velocity]]");
  expect_refused(still + start + "static = true\nvelocities = true\n", "bodies that come to rest");
  expect_refused(replaced(still, "mesh_size = 0.25", "mesh_size = 0.2") + start, "the same geometry and mesh");
  expect_refused(replaced(still, "width = 2", "width = 2, x = 1") + start, "had other places of nodes");
  expect_refused(still + "[quadrature]\ndilatation = false\n" + start, "pressure patches");
  expect_refused(replaced(still, "nu = 0.3", "nu = 0.31") + start, "of another material");
  expect_refused(replaced(still, "density = 1", "density = 2") + start, "of another material");
  expect_refused(still + "[mpm]\ncell = 0.25\n" + start, "method \"otm\"");
  expect_refused(replaced(still, "\"strain\"", "\"axisymmetric\"") + start, "axisymmetric");
  workspace.write("first/dynamics.state", content(workspace / "first/dynamics.state").substr(0, 2000));
  expect_refused(still + start, "damaged");
  const auto same = run_in(workspace, still + start, "first");
  EXPECT_EQ(same.status, 2);
}

TEST(DynamicsStart, ARunGoesOnFromTheStateOfAnotherOne) {
  const Workspace workspace;
  // A strip that turns and vibrates.
  const std::string strip = replaced(with("[0, \"-0.2\"]", "[\"-0.05*x\", \"-0.2*x\"]"), "level = -0.1", "level = -9");
  const std::string second =
      replaced(strip, "[[velocity]]\nvalue = [\"-0.05*x\", \"-0.2*x\"]\n", "[start]\nstate = \"first\"\n");
  ASSERT_EQ(run_in(workspace, replaced(strip, "end = 4", "end = 2"), "first").status, 0);
  ASSERT_EQ(run_in(workspace, strip, "whole").status, 0);
  const auto done = run_in(workspace, replaced(second, "end = 4", "end = 2"), "second");
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("start from the state in"));
  const auto first = json(workspace / "first/result.json"), whole = json(workspace / "whole/result.json"),
             from = json(workspace / "second/result.json");
  EXPECT_EQ(from["time"], 2.0);
  EXPECT_NEAR(from["counts"]["steps"].get<double>() + first["counts"]["steps"].get<double>(),
              whole["counts"]["steps"].get<double>(), 2.0);
  // One step of the first run is cut at its end.
  for (const int axis : {0, 1})
    EXPECT_NEAR(from["momentum"][axis].get<double>(), whole["momentum"][axis].get<double>(), 1e-5);
  EXPECT_NEAR(from["energy"]["stored"].get<double>(), whole["energy"]["stored"].get<double>(), 1e-5);
  EXPECT_NEAR(from["energy"]["start"].get<double>(), whole["energy"]["start"].get<double>(), 1e-4);
  EXPECT_NEAR(from["probes"]["height"].get<double>(), whole["probes"]["height"].get<double>(), 1e-5);
}

TEST(DynamicsStart, WrongStressesAreRefusedWithFileAndLine) {
  const auto refused = [](const std::string& stress) { return refuses(rubber + "[[start.stress]]\n" + stress); };
  EXPECT_THAT(refused("xx = 0\nyy = 0\n"), says("key \"zz\" is missing"));
  EXPECT_THAT(refused("xx = 0\nyy = 0\nzz = \"log(x - 9)\"\n"), says("log(x - 9)"));
  EXPECT_THAT(refused("xx = 0\nyy = 0\nzz = 0\nyz = 0\n"), says("yz"));
  EXPECT_THAT(refused("region = \"bolt\"\nxx = 0\nyy = 0\nzz = 0\n"), says("bolt"));
  EXPECT_THAT(refused("xx = 0\nyy = 0\nzz = 0\n[[start.stress]]\nxx = 0\nyy = 0\nzz = 0\n"), says("stresses already"));
}

TEST(DynamicsStart, StressesOutOfEquilibriumAreWarnedOf) {
  const Workspace workspace;
  const auto start = [](const std::string& yy) {
    return replaced(press, "[time]", "[[start.stress]]\nxx = \"" + yy + "\"\nyy = \"" + yy + "\"\nzz = 0\n[time]");
  };
  const auto free_sides = run_in(workspace, replaced(start("-0.1"), "end = 4", "end = 0.1"), "out");
  ASSERT_EQ(free_sides.status, 0) << free_sides.output;
  EXPECT_THAT(free_sides.output, HasSubstr("Bodies move at the start: the given stresses and loads are not in"));
}

TEST(DynamicsStart, BodiesThatGetNodesUntilTheyAreAtRestStayThere) {
  const Workspace workspace;
  const std::string hanging = R"toml(title = "hanging"
[geometry]
shape = "rectangle"
parameters = { width = 1, height = 4 }
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
gravity = [0, -1]
[otm]
insertion = 1.3
[material]
model = "neo_hookean"
E = 8
nu = 0.3
density = 1
[[boundary]]
on = "top"
velocity = [0, 0]
[start]
residual = 1e-4
[time]
end = 0.1
[output]
frames = 0
)toml";
  const auto done = run_in(workspace, hanging, "out");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_LT(result["energy"]["kinetic"].get<double>(), 1e-3 * result["energy"]["stored"].get<double>());
  const auto refused = run_in(workspace, hanging + "[[velocity]]\nvalue = [0.1, 0]\n", "out");
  EXPECT_EQ(refused.status, 2);
  EXPECT_THAT(refused.output, HasSubstr("nodes were inserted or merged"));
}

/// By body how far it moved as a whole before its static start, and the partner that held it, as warnings have them.
std::map<std::string, std::pair<double, std::string>> rigid_displacements(const fs::path& results) {
  const std::regex pattern("before the run (?:the )?(.*) moved as a whole by (.*), until contact with (.*) held it");
  std::map<std::string, std::pair<double, std::string>> moved;
  const auto result = json(results / "result.json");
  for (const std::string warning : result["reports"]["warnings"])
    if (std::smatch match; std::regex_search(warning, match, pattern))
      moved[match[1]] = {std::stod(match[2]), match[3]};
  return moved;
}

/// Squares of side 1: "low" on a floor at y = 0 and "high" on "low", with these gaps.
std::string stack(const Workspace& workspace, double below, double between, const std::string& floor) {
  std::ofstream(workspace / "stack.geo") << fmt::format(R"geo(SetFactory("OpenCASCADE");
Rectangle(1) = {{0, {}, 0, 1, 1}};
Rectangle(2) = {{0, {}, 0, 1, 1}};
Physical Surface("low") = {{1}};
Physical Surface("high") = {{2}};
)geo",
                                                        below, below + 1.0 + between);
  return replaced(R"toml(title = "stack"
[geometry]
file = "stack.geo"
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
gravity = [0, -1]
[contact]
friction = 0.5
tie = false
[material]
model = "neo_hookean"
E = 20
nu = 0.3
density = 1
FLOOR
[start]
residual = 1e-4
[time]
end = 0.01
[output]
frames = 0
)toml",
                  "FLOOR", floor);
}

const std::string floor_wall = "[[wall]]\nnormal = [0, 1]\nlevel = 0\nfriction = 0.5\n";
const std::string floor_body = "[[rigid_body]]\nshape = \"plane\"\nnormal = [0, 1]\nlevel = 0\nfriction = \"stick\"\n";

TEST(DynamicsStart, BodiesThatCrossAGapBeforeAStaticStartAreWarnedOf) {
  const Workspace workspace;
  const auto moved_in = [&](const std::string& text) {
    const auto done = run_in(workspace, text, "out");
    EXPECT_EQ(done.status, 0) << done.output;
    return rigid_displacements(workspace / "out");
  };
  auto moved = moved_in(stack(workspace, 0.05, 0.03, floor_wall));
  ASSERT_EQ(moved.size(), 2u);
  EXPECT_NEAR(moved["body \"low\""].first, 0.05, 0.01);
  EXPECT_EQ(moved["body \"low\""].second, "wall.0");
  EXPECT_NEAR(moved["body \"high\""].first, 0.03, 0.01);
  EXPECT_EQ(moved["body \"high\""].second, "body \"low\"");
  // Carried along by the one below.
  moved = moved_in(stack(workspace, 0.05, 0.0, floor_body));
  ASSERT_EQ(moved.size(), 1u);
  EXPECT_NEAR(moved["body \"low\""].first, 0.05, 0.01);
  EXPECT_EQ(moved["body \"low\""].second, "rigid_body.0");
  // Elastic: tops sag by 0.06 and more.
  EXPECT_TRUE(moved_in(stack(workspace, 0.0, 0.0, floor_wall)).empty());
}

TEST(DynamicsStart, BodiesThatDeformUntilTheyAreInContactAreNotSaidToMove) {
  const Workspace workspace;
  // A cantilever whose end comes to lie on a wall.
  const auto clamped = [](const std::string& held) {
    return R"toml(title = "cantilever"
[geometry]
shape = "rectangle"
parameters = { width = 4, height = 0.5 }
mesh_size = 0.2
[analysis]
kind = "dynamics"
plane = "strain"
gravity = [0, -1]
[material]
model = "neo_hookean"
E = 500
nu = 0.3
density = 1
[[wall]]
normal = [0, 1]
level = -0.1
[start]
residual = 1e-4
[time]
end = 0.01
[output]
frames = 0
[[boundary]]
on = "left"
)toml" + held;
  };
  const auto run = [&](const std::string& text) {
    const auto done = run_in(workspace, text, "out");
    EXPECT_EQ(done.status, 0) << done.output;
    EXPECT_FALSE(json(workspace / "out/result.json")["contacts"].empty());
    return rigid_displacements(workspace / "out");
  };
  EXPECT_TRUE(run(clamped("velocity = [0, 0]\n")).empty());
  // Held against the wall by nothing, and by springs that are too soft to hold it alone.
  EXPECT_NEAR(run(clamped("velocity = [0, \"free\"]\n"))["body"].first, 0.1, 0.01);
  EXPECT_TRUE(run(clamped("stiffness = [100, 10]\n")).empty());
}

}  // namespace
}  // namespace efree
