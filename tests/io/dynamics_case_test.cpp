// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics from case files: errors of input, results of runs, runs that are killed and resumed.
#include "efree/io/case/case_file.hpp"

#include "efree/core/error.hpp"
#include "efree/tests/io/workspace.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

namespace efree {
namespace {

using test::content, test::json, test::replaced, test::Workspace;
using ::testing::HasSubstr, ::testing::ThrowsMessage;
namespace fs = std::filesystem;

/// A strip of rubber that falls onto a wall and comes back.
const std::string rubber = R"toml(title = "strip"
[geometry]
shape = "rectangle"
parameters = { width = 2, height = 1 }
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1
[[velocity]]
value = [0, "-0.2"]
[[wall]]
normal = [0, 2]
level = -0.1
[time]
end = 4
[output]
frames = 3
history = 20
[[probe]]
name = "height"
extent = "y"
[[probe]]
name = "corner"
at = [2, 1]
)toml";

std::string with(const std::string& from, const std::string& to) {
  return replaced(rubber, from, to);
}
std::string without(const std::string& line) {
  return replaced(rubber, line + "\n", "");
}

/// Reads, and builds the model.
void start(const std::string& text) {
  const Workspace workspace(text);
  const auto build = [](const auto& any) {
    if constexpr (requires { build_dynamics_model(any); })
      build_dynamics_model(any);
    else
      FAIL() << "a static case";
  };
  std::visit(build, read_case(workspace / "case.toml"));
}
auto refuses(const std::string& text) {
  return [text] { start(text); };
}
auto says(const std::string& what) {
  return ThrowsMessage<InputError>(testing::AllOf(HasSubstr("case.toml:"), HasSubstr(what)));
}

TEST(DynamicsCase, WrongInputIsRefusedWithFileAndLine) {
  EXPECT_THAT(refuses(without("density = 1")), says("density is missing"));
  EXPECT_THAT(refuses(with("density = 1", "density = \"1 - x\"")), says("density is -"));
  EXPECT_THAT(refuses(with("\"neo_hookean\"", "\"linear_elastic\"")), says("for small strains"));
  EXPECT_THAT(refuses(with("nu = 0.3", "nu = 0.3\nyield = 1")), says("means nothing for model"));
  EXPECT_THAT(refuses(with("\"neo_hookean\"\nE = 1", "\"j2\"\nyield = 1\nstrain = \"small\"\nE = 1")),
              says("explicit dynamics asks for finite strains"));
  EXPECT_THAT(refuses(with("value = [0", "region = \"bolt\"\nvalue = [0")), says("bolt"));
  EXPECT_THAT(refuses(with("value = [0, \"-0.2\"]", "value = [0]")), says("expected an array of 2"));
  EXPECT_THAT(refuses(with("\"-0.2\"", "\"log(x - 1)\"")), says("log(x - 1)"));
  EXPECT_THAT(refuses(with("\"-0.2\"", "\"-t\"")), says("may depend on the time t"));
  EXPECT_THAT(refuses(rubber + "[definitions]\nt = 2\n"), says("\"t\" already has a meaning"));
  EXPECT_THAT(refuses(with("\"-0.2\"", "\"-w\"") + "[definitions]\nw = \"2*t\"\n"), says("may depend on the time t"));
  const auto forced = [](const std::string& more) {
    return refuses(with("plane = \"strain\"", "plane = \"strain\"\n" + more));
  };
  EXPECT_THAT(forced("gravity = [0]"), says("expected an array of 2"));
  EXPECT_THAT(forced("gravity = [0, \"0.1*x\"]"), says("\"0.1*x\", expected the same everywhere"));
  EXPECT_THAT(forced("gravity = [0, \"t\"]"), says("may depend on the time t"));
  EXPECT_THAT(forced("gravity = [0, \"log(-1)\"]"), says("log(-1)"));
  EXPECT_THAT(forced("body_force = [0, -1]"), says("take gravity"));
  EXPECT_THAT(forced("rotation = { speed = 1 }"), says("a velocity by which they rotate"));
  EXPECT_THAT(refuses(with("plane = \"strain\"", "plane = \"axisymmetric\"\ngravity = [1, 0]")),
              says("gravity of 1 along the radius"));
  EXPECT_THAT(refuses(with("[[wall]]", "[[velocity]]\nvalue = [1, 0]\n[[wall]]")), says("a velocity already"));
  EXPECT_THAT(refuses(with("normal = [0, 2]", "normal = [0, 0]")), says("normal is zero"));
  EXPECT_THAT(refuses(with("level = -0.1", "level = 0.1")), says("reach through the wall by 0.1"));
  EXPECT_THAT(refuses(with("level = -0.1", "friction = \"glue\"")), says("stick"));
  EXPECT_THAT(refuses(with("level = -0.1", "friction = -1")), says("expected a number >= 0"));
  EXPECT_THAT(refuses(with("end = 4", "end = -4")), says("expected a number > 0"));
  EXPECT_THAT(refuses(without("end = 4")), says("\"end\" is missing"));
  EXPECT_THAT(refuses(with("end = 4", "end = 4\nstep = 1")), says("step"));
  EXPECT_THAT(refuses(with("frames = 3", "frames = 2.5")), says("frames"));
  EXPECT_THAT(refuses(with("\"strain\"", "\"stress\"")), says("axisymmetric"));
  EXPECT_THAT(refuses(rubber + "[[boundary]]\non = \"rim\"\nvelocity = [0, 0]\n"), says("rim"));
  EXPECT_THAT(refuses(replaced(with("\"strain\"", "\"axisymmetric\""), "width = 2", "width = 2, x = -1")),
              says("reaches to x = -1"));
  EXPECT_THAT(refuses(rubber + "[[boundary]]\non = \"left\"\nvelocity = [\"free\", \"free\"]\n"),
              says("every component"));
  EXPECT_THAT(refuses(rubber + "[[boundary]]\non = \"left\"\ntraction = [1, 0]\n"), says("traction"));
  EXPECT_THAT(refuses(with("extent = \"y\"", "largest = \"temperature\"")), says("von_mises"));
  EXPECT_THAT(refuses(with("frames = 3", "colour = \"red\"")), says("no field \"red\""));
  EXPECT_THAT(refuses(with("extent = \"y\"", "largest = \"y\"\nsmallest = \"y\"")), says("exactly one of"));
  EXPECT_THAT(refuses(with("\"corner\"", "\"height\"")), says("already is a probe"));
  EXPECT_THAT(refuses(rubber + "[cloud]\nsupport = 2\n"), says("\"spacing\" is missing"));
  EXPECT_THAT(refuses(rubber + "[cloud]\nspacing = 0.5\n[otm]\ngamma = 2\n"), says("leave out [otm], or [cloud]"));
  EXPECT_THAT(refuses(rubber + "[dynamics]\ncourant = 2\n"), says("courant"));
  EXPECT_THAT(refuses(rubber + "[dynamics]\nimbalance = 0\n"), says("imbalance"));
  EXPECT_THAT(refuses(rubber + "[[gas]]\non = \"left\"\npressure = 1\n"), says("not closed"));
  EXPECT_THAT(refuses(rubber + "[cloud]\nspacing = 0.5\n[[gas]]\non = \"left\"\npressure = 1\n"),
              says("leave out [cloud], [mpm] and [sph], and take dynamics.method = \"otm\""));
  EXPECT_THAT(refuses(rubber + "[accuracy]\nenergy = 0.01\n"), says("[accuracy] is for static analyses"));
  EXPECT_THAT(refuses(rubber + "[contact]\nfriction = -1\n"), says("friction"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nneighbourhood = 2\n"), says("expected toughness, stretch or strain"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\ntoughness = -1\n"), says("toughness"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nregion = \"bolt\"\nstretch = 2\n"), says("bolt"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstretch = 2\n[[fracture]]\nstretch = 3\n"), says("fracture already"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = { D1 = 1, D6 = 2 }\n"), says("D6"));
  EXPECT_THAT(refuses(with("\"dynamics\"", "\"motion\"")), says("kind"));
  EXPECT_THAT(refuses(rubber + "[otm]\nseizing = true\n[contact]\nfriction = 0.1\n"), says("friction means nothing"));
  EXPECT_THAT(refuses(rubber + "[cloud]\nspacing = 0.5\n[otm]\nseizing = true\n"), says("leave out [otm], or [cloud]"));
}

TEST(DynamicsCase, MethodsFitTheirTables) {
  EXPECT_THAT(refuses(rubber + "[dynamics]\nmethod = \"fem\"\n"), says("total_lagrangian"));
  EXPECT_THAT(refuses(rubber + "[dynamics]\nmethod = \"total_lagrangian\"\n"), says("add [cloud] with a spacing"));
  EXPECT_THAT(refuses(rubber + "[cloud]\nspacing = 0.5\n[dynamics]\nmethod = \"otm\"\n"),
              says("leave out [cloud], or take method = \"total_lagrangian\""));
  EXPECT_THAT(refuses(rubber + "[otm]\ninsertion = 1.2\n"), says("expected 0, or 1.3 to 10"));
  const auto method = [](const std::string& more) {
    const Workspace workspace(rubber + more);
    return std::get<DynamicsCase<2>>(read_case(workspace / "case.toml")).method;
  };
  EXPECT_EQ(method(""), DynamicsMethod::otm);
  EXPECT_EQ(method("[dynamics]\nmethod = \"otm\"\n"), DynamicsMethod::otm);
  EXPECT_EQ(method("[cloud]\nspacing = 0.5\n"), DynamicsMethod::total_lagrangian);
  EXPECT_EQ(method("[cloud]\nspacing = 0.5\n[dynamics]\nmethod = \"total_lagrangian\"\n"),
            DynamicsMethod::total_lagrangian);
  EXPECT_EQ(method("[mpm]\ncell = 0.25\n"), DynamicsMethod::mpm);
}

TEST(DynamicsCase, TheMaterialPointMethodSaysWhatItNeedsAndWhatFitsItsFrame) {
  EXPECT_THAT(refuses(rubber + "[dynamics]\nmethod = \"mpm\"\n"), says("key \"cell\" is missing in [mpm]"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = -1\n"), says("cell"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\ntransfer = \"apics\"\n"), says("polypic"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\ntransfer = \"apic\"\nflip = 0.9\n"), says("flip is for transfer"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\nframe = \"total\"\ntransfer = \"pic\"\n"),
              says("transfer means nothing with frame = \"total\""));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\nframe = \"mesh\"\npoints = 3\n"), says("take mesh_size"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\nframe = \"mesh\"\nremap = true\n"), says("remap means nothing"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\n[cloud]\nspacing = 0.5\n"),
              says("[mpm] has options of the method"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\n[otm]\ngamma = 2\n"), says("leave out [otm]"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 0.25\n[dynamics]\nmethod = \"otm\"\n"), says("leave out [mpm]"));
  EXPECT_THAT(refuses(rubber + "[mpm]\ncell = 3\n"), says("thicker than the body"));
  EXPECT_THAT(refuses(replaced(rubber, "plane = \"strain\"", "plane = \"axisymmetric\"") + "[mpm]\ncell = 0.25\n"),
              says("not of an axisymmetric section"));
}

TEST(DynamicsCase, FormerKeysAreErrorsThatNameTheirPlace) {
  EXPECT_THAT(refuses(with("kind = \"dynamics\"", "kind = \"otm\"")), says("write kind = \"dynamics\""));
  EXPECT_THAT(refuses(with("plane = \"strain\"", "plane = \"strain\"\nacceleration = [0, -1]")),
              says("write gravity in [analysis]"));
  EXPECT_THAT(refuses(rubber + "[[tool]]\nshape = \"plane\"\n"), says("write [[rigid_body]]"));
  for (const auto& [former, place] : {std::pair("renewal = 0.1", "reconnection_strain in [otm]"),
                                      {"injection = 2", "insertion in [otm]"},
                                      {"courant = 0.4", "courant in [dynamics]"},
                                      {"imbalance = 0.2", "imbalance in [dynamics]"},
                                      {"shock = { linear = 0.1 }", "shock in [dynamics]"}})
    EXPECT_THAT(refuses(rubber + "[otm]\n" + former + "\n"), says(std::string("write ") + place)) << former;
  EXPECT_THAT(refuses(rubber + "[contact]\nseizing = true\n"), says("write seizing in [otm]"));
}

TEST(DynamicsCase, WrongRigidBodiesAreRefusedWithFileAndLine) {
  const auto with_rigid_body = [](const std::string& body) { return refuses(rubber + "[[rigid_body]]\n" + body); };
  EXPECT_THAT(with_rigid_body("velocity = [0, 1]\n"), says("shape"));
  EXPECT_THAT(with_rigid_body("shape = \"cone\"\n"), says("polygon"));
  EXPECT_THAT(with_rigid_body("shape = \"ball\"\nradius = 1\n"), says("centre"));
  EXPECT_THAT(with_rigid_body("shape = \"ball\"\ncentre = [1, 3]\nradius = 0\n"), says("radius"));
  EXPECT_THAT(with_rigid_body("shape = \"ball\"\ncentre = [1, 3]\nradius = 1\nlevel = 1\n"),
              says("level means nothing"));
  EXPECT_THAT(with_rigid_body("shape = \"ball\"\ncentre = [1, 1.5]\nradius = 1\n"),
              says("reach into the rigid body by 0.5"));
  EXPECT_THAT(with_rigid_body("shape = \"plane\"\nnormal = [0, 0]\n"), says("normal is zero"));
  EXPECT_THAT(with_rigid_body("shape = \"polygon\"\npoints = [[0, 2], [1, 2], [2, 2]]\n"), says("enclose nothing"));
  const std::string plane = "shape = \"plane\"\nnormal = [0, -1]\nlevel = -2\n";
  EXPECT_THAT(with_rigid_body(plane + "velocity = [0, \"x\"]\n"), says("time t alone"));
  EXPECT_THAT(with_rigid_body(plane + "spin = 1\n"), says("centre"));
  EXPECT_THAT(with_rigid_body(plane + "mass = -1\n"), says("mass"));
  EXPECT_THAT(with_rigid_body(plane + "friction = \"glue\"\n"), says("stick"));
}

TEST(DynamicsCase, CasesOfOneKindAreNoneOfTheOther) {
  const Workspace still, moving(rubber);
  EXPECT_TRUE(std::holds_alternative<Case<2>>(read_case(still / "case.toml")));
  EXPECT_TRUE(std::holds_alternative<DynamicsCase<2>>(read_case(moving / "case.toml")));
  EXPECT_THAT([&] { read_static_case(moving / "case.toml"); }, says("efree run"));
  const Workspace wrong(with("\"dynamics\"", "\"dynamic\"")), unsaid(without("kind = \"dynamics\""));
  EXPECT_THAT([&] { read_case(wrong / "case.toml"); },
              says("kind is \"dynamic\", expected \"static\" or \"dynamics\""));
  EXPECT_THAT([&] { read_case(unsaid / "case.toml"); }, says("[velocity] is for explicit dynamics"));
}

TEST(DynamicsCase, NormalsOfAnyLengthAreUnitVectors) {
  for (const char* normal : {"[0, 2]", "[0, 2e300]", "[0, 2e-310]"}) {
    const Workspace workspace(with("normal = [0, 2]", std::string("normal = ") + normal) +
                              "[[rigid_body]]\nshape = \"plane\"\nlevel = -0.2\nnormal = " + normal + "\n");
    const auto of = std::get<DynamicsCase<2>>(read_case(workspace / "case.toml"));
    EXPECT_EQ(of.walls.at(0).wall.normal, Vec<2>(0, 1)) << normal;
    EXPECT_EQ(of.rigid_bodies.at(0).body.shape(Vec<2>(0.3, 0.0)).normal, Vec<2>(0, 1)) << normal;
  }
}

TEST(DynamicsCase, TimesFarBelowAStepAreRefused) {
  for (const char* time : {"end = 1e-300", "end = 4\nmax_step = 1e-300"}) {
    const Workspace workspace(with("end = 4", time));
    const auto of = std::get<DynamicsCase<2>>(read_case(workspace / "case.toml"));
    EXPECT_THAT([&] { build_dynamics_model(of); }, says("next to nothing compared with a stable step")) << time;
  }
}

TEST(DynamicsCase, BodiesAreAsTheCaseSays) {
  const Workspace workspace(with("level = -0.1", "level = -0.1\nfriction = \"stick\"") +
                            "[otm]\ngamma = 1.5\nreconnection_strain = 0.1\n");
  const auto of = std::get<DynamicsCase<2>>(read_case(workspace / "case.toml"));
  ASSERT_EQ(of.walls.size(), 1u);
  EXPECT_EQ(of.walls[0].wall.normal, Vec<2>(0, 1));
  EXPECT_TRUE(std::isinf(of.walls[0].wall.friction));
  EXPECT_EQ(of.otm.lme.gamma, 1.5);
  EXPECT_EQ(of.otm.reconnection_strain, 0.1);
  const DynamicsModel<2> model = build_dynamics_model(of);
  EXPECT_EQ(model.dynamics.num_bodies(), 1);
  EXPECT_NEAR(model.dynamics.masses().sum(), 2.0, 1e-12);
  EXPECT_NEAR(model.dynamics.balance().momentum[1], -0.4, 1e-12);
  EXPECT_EQ(model.dynamics.velocities().row(0).cwiseAbs().maxCoeff(), 0.0);
}

Workspace::Run run(const Workspace& workspace, const std::string& text, std::vector<std::string> more = {}) {
  workspace.write("case.toml", text);
  std::vector<std::string> arguments{"run", "case.toml", "--out", "out", "--threads", "1", "--no-picture"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return workspace.efree(arguments);
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

/// A column of history.csv.
std::vector<double> column(const fs::path& file, const std::string& name) {
  std::istringstream lines(content(file));
  std::string line, cell;
  std::getline(lines, line);
  std::istringstream header(line);
  std::size_t at = 0;
  while (std::getline(header, cell, ',') && cell != name) ++at;
  EXPECT_EQ(cell, name);
  std::vector<double> values;
  while (std::getline(lines, line)) {
    std::istringstream cells(line);
    for (std::size_t k = 0; k <= at; ++k) std::getline(cells, cell, ',');
    values.push_back(std::stod(cell));
  }
  return values;
}

TEST(DynamicsRun, BodiesWithoutANodeInsideAreWarnedOf) {
  const Workspace workspace;
  const std::string coarse = "squeezing of the body are not resolved";
  const auto done = run(workspace, replaced(with("mesh_size = 0.25", "mesh_size = 5"), "end = 4", "end = 0.1"));
  EXPECT_EQ(done.status, 0);
  EXPECT_THAT(done.output, HasSubstr(coarse));
  const auto fine = run(workspace, with("end = 4", "end = 0.1"));
  EXPECT_EQ(fine.status, 0);
  EXPECT_THAT(fine.output, ::testing::Not(HasSubstr(coarse)));
}

TEST(DynamicsRun, StripComesBackFromTheWallWithItsEnergyAccounted) {
  const Workspace workspace;
  const auto done = run(workspace, rubber);
  ASSERT_EQ(done.status, 0) << done.output;
  const fs::path out = workspace / "out";
  EXPECT_EQ(names_in(out), (std::set<std::string>{"bodies.vtu", "history.csv", "nodes.pvd", "nodes_0000.vtu",
                                                  "nodes_0001.vtu", "nodes_0002.vtu", "nodes_0003.vtu",
                                                  "dynamics.state", "points.pvd", "points_0000.vtu", "points_0001.vtu",
                                                  "points_0002.vtu", "points_0003.vtu", "result.json"}));
  const auto result = json(out / "result.json");
  EXPECT_EQ(result["kind"], "dynamics");
  EXPECT_EQ(result["method"], "otm");
  EXPECT_EQ(result["time"], 4.0);
  EXPECT_NEAR(result["energy"]["start"].get<double>(), 0.04, 1e-12);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
  EXPECT_GT(result["momentum"][1].get<double>(), 0.1);  // upwards
  EXPECT_NEAR(result["momentum"][0].get<double>(), 0.0, 1e-12);
  EXPECT_TRUE(result["reports"]["warnings"].empty());
  double share = 0.0;
  for (const auto& of : result["shares"]) share += of.get<double>();
  EXPECT_NEAR(share, 1.0, 1e-9);
  const auto t = column(out / "history.csv", "t"), height = column(out / "history.csv", "probe.height"),
             corner = column(out / "history.csv", "probe.corner.uy"),
             vy = column(out / "history.csv", "probe.corner.vy");
  EXPECT_GE(t.size(), 20u);
  EXPECT_LE(t.size(), 22u);
  EXPECT_EQ(t.front(), 0.0);
  EXPECT_EQ(t.back(), 4.0);
  EXPECT_EQ(vy.front(), -0.2);
  EXPECT_EQ(corner.back(), result["probes"]["corner"]["displacement"][1].get<double>());
  EXPECT_EQ(height.back(), result["probes"]["height"].get<double>());
  EXPECT_LT(*std::ranges::min_element(height), 0.95);
}

TEST(DynamicsRun, AFallingBodyHasTheWorkOfGravity) {
  const Workspace workspace;
  const std::string falls =
      replaced(replaced(rubber, "[analysis]", "[definitions]\ng = 0.05\n[analysis]\ngravity = [0, \"-g\"]"), "end = 4",
               "end = 1.9");
  const auto done = run(workspace, replaced(falls, "value = [0, \"-0.2\"]", "value = [0, 0]"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  const double way = 0.5 * 0.05 * 1.9 * 1.9, speed = 0.05 * 1.9;
  EXPECT_NEAR(result["probes"]["corner"]["displacement"][1].get<double>(), -way, 1e-13);
  EXPECT_NEAR(result["energy"]["kinetic"].get<double>(), speed * speed, 1e-13);
  EXPECT_NEAR(result["energy"]["gravity"].get<double>(), 2.0 * 0.05 * way, 1e-13);
  EXPECT_NEAR(result["energy"]["total"].get<double>(), 0.0, 1e-13);
  EXPECT_EQ(column(workspace / "out/history.csv", "gravity").back(), result["energy"]["gravity"].get<double>());
}

/// A strip that flies up between a plane that comes down and a ball with a mass below.
const std::string between_rigid_bodies =
    replaced(rubber, "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", R"toml([definitions]
quick = 0.1
[[rigid_body]]
shape = "plane"
normal = [0, -1]
level = -1.05
friction = "stick"
velocity = ["0.1*quick*sin(t)", "-quick*t"]
[[rigid_body]]
shape = "ball"
centre = [1, -1.6]
radius = 1.5
mass = 1
)toml");

TEST(DynamicsRun, RigidBodiesMoveAsTheCaseSaysAndTheirImpulseAndWorkAreInTheBalance) {
  const Workspace workspace;
  const auto done = run(workspace, between_rigid_bodies);
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  const auto& plane = result["rigid_bodies"][0];
  EXPECT_NEAR(plane["centre"][1].get<double>(), -0.8, 1e-4);  // t^2 / 20
  EXPECT_NEAR(plane["centre"][0].get<double>(), 0.01 * (1.0 - std::cos(4.0)), 1e-5);
  EXPECT_NEAR(plane["work"].get<double>(), result["energy"]["prescribed"].get<double>(), 1e-12);
  EXPECT_GT(plane["work"].get<double>(), 0.01);
  // Nothing else pushes the strip and the ball.
  EXPECT_NEAR(result["momentum"][1].get<double>(), -0.4 - plane["impulse"][1].get<double>(), 1e-12);
  EXPECT_NEAR(result["rigid_bodies"][1]["velocity"][1].get<double>(),
              result["rigid_bodies"][1]["impulse"][1].get<double>(), 1e-12);
  EXPECT_LT(result["rigid_bodies"][1]["velocity"][1].get<double>(), -0.1);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
  EXPECT_EQ(column(workspace / "out/history.csv", "rigid_body.0.work").back(), plane["work"].get<double>());
  EXPECT_EQ(column(workspace / "out/history.csv", "rigid_body.1.centre.y").back(),
            result["rigid_bodies"][1]["centre"][1]);
  EXPECT_EQ(column(workspace / "out/history.csv", "rigid_body.0.force.y").back(), plane["force"][1].get<double>());
}

TEST(DynamicsRun, InSpaceRigidBodiesAreSurfacesOfFilesAndRoundBars) {
  const Workspace workspace;
  workspace.write("wedge.off",
                  "OFF\n6 8 0\n-1 -1 -0.2\n2 -1 -0.2\n2 2 -0.2\n-1 2 -0.2\n0.5 0.5 -0.05\n0.5 0.5 -1\n3 0 1 4\n"
                  "3 1 2 4\n3 2 3 4\n3 3 0 4\n3 1 0 5\n3 2 1 5\n3 3 2 5\n3 0 3 5\n");
  const auto done = run(workspace, R"toml([geometry]
shape = "box"
parameters = { width = 1, depth = 1, height = 1 }
mesh_size = 0.4
[analysis]
kind = "dynamics"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1
[[rigid_body]]
shape = "surface"
file = "wedge.off"
velocity = [0, 0, 0.2]
friction = 0.3
[[rigid_body]]
shape = "cylinder"
centre = [0.5, 0.5, 1.55]
axis = [0, 1, 0]
radius = 0.5
mass = 2
inertia = 0.25
spin = [0, 0.5, 0]
[time]
end = 2
)toml");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  const auto &wedge = result["rigid_bodies"][0], &bar = result["rigid_bodies"][1];
  EXPECT_NEAR(wedge["centre"][2].get<double>(), 0.4, 1e-12);
  EXPECT_GT(bar["impulse"][2].get<double>(), 0.01);
  EXPECT_NEAR(2.0 * bar["velocity"][2].get<double>(), bar["impulse"][2].get<double>(), 1e-12);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(result["momentum"][i].get<double>(), -wedge["impulse"][i].get<double>(), 1e-12);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
}

TEST(DynamicsRun, ARodUnderARollGetsAsThinAsThereIsRoomAndBothAreDrawn) {
  const Workspace workspace;
  const std::string given = content(fs::path(EFREE_EXAMPLES) / "impact/pressed_rod.toml");
  workspace.write("case.toml",
                  replaced(replaced(given, "mesh_size = 1.4", "mesh_size = 3"), "end = 1.5e-4", "end = 1e-4"));
  const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet"});
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_NEAR(result["rigid_bodies"][0]["centre"][0].get<double>(), 9.05 - 2.0, 1e-9);
  // Between the plane at -3.05 and the roll, whose lowest line is at 1.05; points are inside by a part of the spacing.
  EXPECT_LT(result["probes"]["thickness"].get<double>(), 4.1 * 1.02);
  EXPECT_GT(result["probes"]["thickness"].get<double>(), 4.1 * 0.8);
  EXPECT_NEAR(result["walls"][0]["force"][0].get<double>() / result["rigid_bodies"][0]["force"][0].get<double>(), -1.0,
              0.25);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
  EXPECT_GT(fs::file_size(workspace / "out/frame_0006.png"), 1000u);
}

TEST(DynamicsRun, SolveIsTheSameAndHistoryDoesNotChangeSteps) {
  const Workspace one, other;
  ASSERT_EQ(run(one, rubber).status, 0);
  other.write("case.toml", replaced(replaced(rubber, "frames = 3", "frames = 1"), "history = 20", "history = 7"));
  ASSERT_EQ(other.efree({"solve", "case.toml", "--out", "out", "--quiet"}).status, 0);
  EXPECT_EQ(content(one / "out/nodes_0003.vtu"), content(other / "out/nodes_0001.vtu"));
  EXPECT_GT(fs::file_size(other / "out/frame_0001.png"), 1000u);
}

TEST(DynamicsRun, NodesOnACloudFollowTheShapeFunctionsOfTheStaticSolver) {
  const Workspace workspace;
  const auto done = run(workspace, with("mesh_size = 0.25", "mesh_size = 0.06") +
                                       "[cloud]\nspacing = 0.3\n[[boundary]]\non = \"top\"\nvelocity = [0, -0.05]\n");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_EQ(result["method"], "total_lagrangian");
  EXPECT_LT(result["counts"]["nodes"].get<int>(), 80);
  EXPECT_NEAR(result["probes"]["corner"]["displacement"][1].get<double>(), -0.2, 1e-12);
  EXPECT_EQ(result["probes"]["corner"]["displacement"][0].get<double>(), 0.0);
}

TEST(DynamicsRun, MaterialPointsOnAGridBounceAsTheirSplinesInTheReferenceConfigurationDo) {
  const auto height = [](const std::string& more, const std::string& mesh_size = "0.25") {
    const Workspace workspace;
    workspace.write("case.toml",
                    replaced(rubber, "mesh_size = 0.25", "mesh_size = " + mesh_size) + "[mpm]\ncell = 0.125\n" + more);
    const auto done = workspace.efree({"run", "case.toml", "--out", "out", "--quiet"});
    EXPECT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
    EXPECT_GT(fs::file_size(workspace / "out/frame_0003.png"), 1000u);
    return std::pair(result["probes"]["height"].get<double>(),
                     result["probes"]["corner"]["displacement"][1].get<double>());
  };
  const auto updated = height(""), total = height("frame = \"total\"\n"), mesh = height("frame = \"mesh\"\n", "0.0625");
  EXPECT_NEAR(updated.first, total.first, 0.02);
  EXPECT_NEAR(updated.second, total.second, 0.03);
  EXPECT_NEAR(mesh.first, total.first, 0.02);
  EXPECT_NEAR(mesh.second, total.second, 0.03);
  EXPECT_GT(total.second, 0.1);  // it has come back
}

TEST(DynamicsRun, PartsOfTheBoundaryTakeMaterialPointsAlong) {
  for (const char* frame : {"updated", "total", "mesh"}) {
    const Workspace workspace;
    const auto done =
        run(workspace, without("[[wall]]\nnormal = [0, 2]\nlevel = -0.1") + "[mpm]\ncell = 0.125\nframe = \"" + frame +
                           "\"\n[[boundary]]\non = \"top\"\nvelocity = [0, -0.2]\n");
    ASSERT_EQ(done.status, 0) << done.output;
    const auto result = json(workspace / "out/result.json");
    // Of the corner, half of a point's size from the point that is held.
    EXPECT_NEAR(result["probes"]["corner"]["displacement"][1].get<double>(), -0.8, 0.01) << frame;
  }
}

TEST(DynamicsRun, PartsOfTheBoundaryTurnAsTheCaseSays) {
  // A strip whose whole boundary turns by 1 rad about its lower left corner, in time 4 from rest.
  const std::string turned =
      replaced(without("[[wall]]\nnormal = [0, 2]\nlevel = -0.1"), "value = [0, \"-0.2\"]", "value = [0, 0]") +
      "[definitions]\na = \"t^2/16\"\nw = \"t/8\"\n[[boundary]]\non = [\"left\", \"right\", \"bottom\", \"top\"]\n"
      "velocity = [\"-w*(x*sin(a) + y*cos(a))\", \"w*(x*cos(a) - y*sin(a))\"]\n";
  for (const std::string method :
       {"", "[cloud]\nspacing = 0.3\n[dynamics]\nmethod = \"total_lagrangian\"\n", "[mpm]\ncell = 0.125\n",
        "[mpm]\ncell = 0.125\nframe = \"total\"\n", "[mpm]\ncell = 0.125\nframe = \"mesh\"\n"}) {
    const Workspace workspace;
    const auto done =
        run(workspace, replaced(turned, "mesh_size = 0.25",
                                method.find("mesh") < method.size() ? "mesh_size = 0.0625" : "mesh_size = 0.25") +
                           method);
    ASSERT_EQ(done.status, 0) << done.output;
    const auto probe = json(workspace / "out/result.json")["probes"]["corner"]["displacement"];
    // Of mpm the corner of the point next to it.
    EXPECT_NEAR(probe[0].get<double>(), 2.0 * std::cos(1.0) - std::sin(1.0) - 2.0, 0.02) << method;
    EXPECT_NEAR(probe[1].get<double>(), 2.0 * std::sin(1.0) + std::cos(1.0) - 1.0, 0.02) << method;
  }
  // What is not finite at some time says when.
  const Workspace workspace;
  const auto lost = run(workspace, replaced(turned, "w = \"t/8\"", "w = \"log(1 - t)\""));
  EXPECT_EQ(lost.status, 2);
  EXPECT_THAT(lost.output, HasSubstr(", t = 1"));
}

TEST(DynamicsRun, PointsThatBreakAreCountedAndTheirEnergyIsInTheBalance) {
  const Workspace workspace;
  // Pulled apart, the right end faster.
  const std::string pulled =
      replaced(replaced(rubber, "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", ""), "\"-0.2\"", "\"0.02*x*(2*y - 1)\"");
  const auto done =
      run(workspace, pulled +
                         "[[boundary]]\non = \"top\"\nvelocity = [0, \"0.02*x\"]\n[[boundary]]\non = \"bottom\"\n"
                         "velocity = [0, \"-0.02*x\"]\n[[fracture]]\nstretch = 1.2\n");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_GT(result["counts"]["eroded_points"].get<int>(), 5);
  EXPECT_LT(result["counts"]["eroded_points"].get<int>(), result["counts"]["material_points"].get<int>());
  EXPECT_GT(result["energy"]["fracture"].get<double>(), 0.0);
  EXPECT_EQ(result["extremes"]["damage"]["max"]["value"].get<double>(), 1.0);
  EXPECT_EQ(column(workspace / "out/history.csv", "eroded_points").back(),
            result["counts"]["eroded_points"].get<double>());
  EXPECT_EQ(column(workspace / "out/history.csv", "fracture").back(), result["energy"]["fracture"].get<double>());
}

/// two.geo: a unit square "one" at the origin and another, "two", that begins at x.
void write_two_squares(const Workspace& workspace, double x) {
  workspace.write("two.geo", fmt::format(R"(SetFactory("OpenCASCADE");
Rectangle(1) = {{0, 0, 0, 1, 1}};
Rectangle(2) = {{{}, 0, 0, 1, 1}};
Physical Surface("one") = {{1}};
Physical Surface("two") = {{2}};
)",
                                         x));
}

TEST(DynamicsRun, RegionsAreBodiesOfTheirOwn) {
  const Workspace workspace;
  write_two_squares(workspace, 3);
  const std::string material = "model = \"neo_hookean\"\nE = 1\nnu = 0.3\n";
  const auto done = run(workspace,
                        "[geometry]\nfile = \"two.geo\"\nmesh_size = 0.3\n[analysis]\nkind = \"dynamics\"\n"
                        "plane = \"strain\"\n[[material]]\nregion = \"one\"\ndensity = 1\n" +
                            material + "[[material]]\nregion = \"two\"\ndensity = 3\n" + material +
                            "[[velocity]]\nregion = \"two\"\nvalue = [1, 0]\n[time]\nend = 0.5\n"
                            "[[probe]]\nname = \"one\"\nlargest = \"x\"\nregion = \"one\"\n"
                            "[[probe]]\nname = \"two\"\nsmallest = \"x\"\nregion = \"two\"\n");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_EQ(result["bodies"], (std::vector<std::string>{"one", "two"}));
  EXPECT_NEAR(result["momentum"][0].get<double>(), 3.0, 1e-12);
  EXPECT_NEAR(result["probes"]["one"].get<double>(), 1.0, 1e-12);
  EXPECT_NEAR(result["probes"]["two"].get<double>(), 3.5, 1e-12);
}

TEST(DynamicsRun, BodiesThatOverlapAtTheStartAreRefused) {
  const std::string material = "density = 1\nmodel = \"neo_hookean\"\nE = 1\nnu = 0.3\n";
  const std::string two =
      "[geometry]\nfile = \"two.geo\"\n[analysis]\nkind = \"dynamics\"\nplane = \"strain\"\n"
      "[[material]]\nregion = \"one\"\n" +
      material + "[[material]]\nregion = \"two\"\n" + material + "[time]\nend = 1\n";
  for (const char* contact : {"", "[otm]\nseizing = true\n", "[contact]\nstiffness = 0\n"}) {
    const Workspace workspace;
    write_two_squares(workspace, 0.6);
    const auto done = run(workspace, two + contact);
    if (std::string(contact).find("stiffness") != std::string::npos) {
      EXPECT_EQ(done.status, 0) << done.output;
      continue;
    }
    EXPECT_EQ(done.status, 2) << done.output;
    EXPECT_THAT(done.output,
                testing::AllOf(HasSubstr("case.toml:1: bodies overlap at the start"), HasSubstr("\"one\"")));
    EXPECT_FALSE(fs::exists(workspace / "out"));
  }
  const Workspace workspace;
  write_two_squares(workspace, 1.0);  // side by side
  EXPECT_EQ(run(workspace, two).status, 0);
}

/// The second of two squares moves towards the first; `more`: tables besides.
std::string approaching_squares(const std::string& material_one, const std::string& material_two,
                                const std::string& more) {
  return "[geometry]\nfile = \"two.geo\"\nmesh_size = 0.2\n[analysis]\nkind = \"dynamics\"\nplane = \"strain\"\n"
         "[[material]]\nregion = \"one\"\n" +
         material_one + "[[material]]\nregion = \"two\"\n" + material_two +
         "[[velocity]]\nregion = \"two\"\nvalue = [-0.1, 0]\n" + more +
         "[[probe]]\nname = \"gap\"\nsmallest = \"x\"\nregion = \"two\"\n"
         "[[probe]]\nname = \"one\"\nlargest = \"x\"\nregion = \"one\"\n";
}

TEST(DynamicsRun, BodiesThatMeetPushEachOtherAndMassVariesAsTheCaseSays) {
  const Workspace workspace;
  write_two_squares(workspace, 1.1);
  const std::string material = "model = \"neo_hookean\"\nE = 1\nnu = 0.3\n";
  const auto done = run(workspace, approaching_squares("density = \"1 + y\"\n" + material, "density = 1.5\n" + material,
                                                       "[contact]\nfriction = 0.1\n[time]\nend = 8\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_NEAR(result["momentum"][0].get<double>(), -0.15, 1e-12);  // both bodies have a mass of 1.5
  EXPECT_GT(result["probes"]["gap"].get<double>(), result["probes"]["one"].get<double>() - 0.02);
  EXPECT_LT(result["probes"]["one"].get<double>(), 0.9);  // pushed away
}

TEST(DynamicsRun, BodiesThatSeizeMoveOnAsOne) {
  const Workspace workspace;
  write_two_squares(workspace, 1.1);
  const std::string material = "density = 1\nmodel = \"j2\"\nE = 1\nnu = 0.3\nyield = 0.02\n";
  const auto done =
      run(workspace, approaching_squares(material, material, "[otm]\nseizing = true\n[time]\nend = 20\n"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_NEAR(result["momentum"][0].get<double>(), -0.1, 1e-12);
  EXPECT_NEAR(result["probes"]["gap"].get<double>() - result["probes"]["one"].get<double>(), 0.0, 0.07);
  EXPECT_NEAR(result["energy"]["kinetic"].get<double>(), 0.0025, 0.0004);  // of 0.005
}

TEST(DynamicsRun, PointsOfViscousFluidsAndOfRateDependentMetalsAreMerged) {
  const auto thrown = [](const std::string& material) {
    return "[geometry]\nshape = \"rectangle\"\nparameters = { width = 0.2, height = 0.4 }\nmesh_size = 0.04\n"
           "[analysis]\nkind = \"dynamics\"\nplane = \"strain\"\n[material]\ndensity = 1000\n" +
           material +
           "[[velocity]]\nvalue = [0, -3]\n[[wall]]\nnormal = [0, 1]\n[otm]\ninsertion = 1.3\n[time]\nend = 0.04\n";
  };
  for (const char* material :
       {"model = \"tait\"\nkappa = 2.2e6\nexponent = 7\nviscosity = 1\n",
        "model = \"johnson_cook\"\nE = 2e6\nnu = 0.3\nA = 300\nC = 0.02\nreference_rate = 1\n"}) {
    const Workspace workspace;
    const auto done = run(workspace, thrown(material));
    ASSERT_EQ(done.status, 0) << done.output;
    EXPECT_GT(json(workspace / "out/result.json")["counts"]["merged_points"], 0) << material;
  }
}

/// Shape functions at the rim of a splash get narrow: to keep all first moments of velocities on these would take more
/// energy than there is.
TEST(DynamicsRun, ADropThatSplashesWithInsertedNodesGainsNoEnergyByReconnection) {
  const Workspace workspace;
  workspace.write("disk.geo",
                  "SetFactory(\"OpenCASCADE\");\nDisk(1) = {0, 5e-3, 0, 5e-3};\nPhysical Surface(\"drop\") = {1};\n");
  const auto done = run(workspace, R"toml([geometry]
file = "disk.geo"
mesh_size = 1e-3
[analysis]
kind = "dynamics"
plane = "strain"
[material]
model = "tait"
kappa = 2.2e7
exponent = 7
density = 1000
[[velocity]]
value = [0, -10]
[[wall]]
normal = [0, 1]
[otm]
insertion = 2
[dynamics]
shock = { linear = 0.5, quadratic = 2 }
[time]
end = 0.7e-3
[output]
history = 200
)toml");
  ASSERT_EQ(done.status, 0) << done.output;
  const auto kinetic = column(workspace / "out/history.csv", "kinetic"),
             lost = column(workspace / "out/history.csv", "reconnection");
  for (std::size_t k = 1; k < lost.size(); ++k) EXPECT_GT(lost[k], lost[k - 1] - 0.005 * kinetic.front()) << k;
  const auto result = json(workspace / "out/result.json");
  EXPECT_GT(result["counts"]["inserted_nodes"].get<int>(), 10);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
  EXPECT_NEAR(result["momentum"][0].get<double>(), 0.0, 1e-9);
}

TEST(DynamicsRun, AStrongShockInAFluidOnTrianglesIsAsFastAsItsHugoniotSays) {
  const std::string fluid =
      "[geometry]\nshape = \"rectangle\"\nparameters = { width = 0.1, height = 0.5 }\nmesh_size = 0.02\n"
      "[analysis]\nkind = \"dynamics\"\nplane = \"strain\"\n[material]\nmodel = \"mie_grueneisen\"\ndensity = 2700\n"
      "sound_speed = 5350\nslope = 1.34\ngamma = 2\n[[boundary]]\non = \"left\"\nvelocity = [0, \"free\"]\n"
      "[[boundary]]\non = \"right\"\nvelocity = [0, \"free\"]\n[[velocity]]\nvalue = [0, -1000]\n"
      "[[wall]]\nnormal = [0, 1]\n[dynamics]\nshock = { linear = 0.5, quadratic = 2 }\n[time]\nend = 5e-5\n";
  const Workspace workspace;
  const auto done = run(workspace, fluid);
  ASSERT_EQ(done.status, 0) << done.output;
  const auto momentum = column(workspace / "out/history.csv", "momentum.y");
  // The shock goes back through what comes at sound_speed + slope speed.
  const double passed = (5350.0 + 1.34 * 1000.0) * 5e-5 / 0.5;
  EXPECT_NEAR(1.0 - momentum.back() / momentum.front(), passed, 0.02 * passed);
}

TEST(DynamicsRun, EnergyLostByReconnectionIsWarnedOf) {
  const Workspace workspace;
  const std::string ring =
      replaced(replaced(rubber, "\"rectangle\"", "\"annulus\""), "width = 2, height = 1", "inner = 0.7, outer = 1");
  const auto done = run(workspace, replaced(replaced(ring, "\"-0.2\"", "\"-0.4\""), "level = -0.1", "level = -1.05") +
                                       "[dynamics]\nimbalance = 1\n");
  EXPECT_THAT(done.output, HasSubstr("reconnection has dissipated"));
  EXPECT_THAT(run(workspace, rubber).output, testing::Not(HasSubstr("reconnection has dissipated")));
}

TEST(DynamicsRun, StepsThatAreNextToNothingEndTheRunWhateverMakesThemSo) {
  const Workspace workspace;
  const auto done =
      run(workspace, rubber + "[[rigid_body]]\nshape = \"plane\"\nnormal = [0, 1]\nlevel = -9\nvelocity = [0, -1e6]\n");
  EXPECT_EQ(done.status, 3) << done.output;
  EXPECT_THAT(done.output, HasSubstr("less than min_step"));
  EXPECT_EQ(json(workspace / "out/result.json")["counts"]["steps"], 100);
}

TEST(DynamicsRun, VelocitiesOfRigidBodiesThatAreNotFiniteEndTheRunWithTheTime) {
  const Workspace workspace;
  const auto done = run(workspace, rubber +
                                       "[[rigid_body]]\nshape = \"plane\"\nnormal = [0, -1]\nlevel = -9\n"
                                       "velocity = [0, \"log(1.5 - t)\"]\n");
  EXPECT_EQ(done.status, 2) << done.output;
  EXPECT_THAT(done.output, HasSubstr("is nan at t = 1.5"));
}

TEST(DynamicsRun, AnErrorOfTheEnergyBalanceEndsTheRunWithTheResultsUntilThen) {
  const Workspace workspace;
  // Steps at the bound of stability of a body that is thrown flat, with new shape functions in every step.
  const std::string wild =
      replaced(replaced(rubber, "value = [0, \"-0.2\"]", "value = [\"x\", \"-4*y\"]"), "level = -0.1", "level = 0") +
      "[dynamics]\ncourant = 1\n[otm]\nreconnection_strain = 0\n";
  const auto done = run(workspace, wild);
  EXPECT_EQ(done.status, 3) << done.output;
  const auto failure = json(workspace / "out/failure.json");
  EXPECT_EQ(failure["stage"], "dynamics");
  EXPECT_EQ(failure["results"], "of this run");
  EXPECT_THAT(failure["reason"].get<std::string>(), HasSubstr("the energy is off by"));
  EXPECT_GE(column(workspace / "out/history.csv", "t").size(), 1u);
  EXPECT_TRUE(fs::exists(workspace / "out/points_0000.vtu"));
  EXPECT_FALSE(fs::exists(workspace / "out/unfinished"));
  // A stricter limit counts.
  const auto strict = run(workspace, rubber + "[dynamics]\nimbalance = 1e-9\n");
  EXPECT_EQ(strict.status, 3) << strict.output;
  EXPECT_THAT(json(workspace / "out/failure.json")["reason"].get<std::string>(), HasSubstr("the energy is off by"));
  // And one that ends well takes its place.
  ASSERT_EQ(run(workspace, rubber).status, 0);
  EXPECT_FALSE(fs::exists(workspace / "out/failure.json"));
}

/// Of many steps, with a checkpoint every hundredth of a second.
std::string long_run() {
  return replaced(replaced(replaced(rubber, "mesh_size = 0.25", "mesh_size = 0.1"), "end = 4", "end = 12"),
                  "frames = 3\nhistory = 20", "frames = 12\nhistory = 300\ncheckpoint = 0.01");
}

/// Runs it, and sends a signal once history.csv has this many lines. The status it ends with.
int stopped(const Workspace& work, const std::string& out, int lines, int signal, bool resume = false) {
  const std::string script = fmt::format(
      "\"{}\" run case.toml --out {} --no-picture --quiet --threads 1 {} & p=$!\n"
      "while kill -0 $p 2>/dev/null && {{ [ ! -e {}/unfinished/dynamics.state ] || "
      "[ $(cat {}/unfinished/history.csv 2>/dev/null | wc -l) -lt {} ]; }}; do sleep 0.01; done\n"
      "kill -{} $p; wait $p",
      EFREE_PROGRAM, out, resume ? "--resume" : "", out, out, lines, signal);
  std::string output;
  return run_program(work / "", {"/bin/sh", "-c", script}, &output);
}

/// But for the clock.
nlohmann::json numbers(const fs::path& folder) {
  auto all = json(folder / "result.json");
  for (const char* key : {"seconds", "shares", "peak_memory_mb", "threads"}) all.erase(key);
  return all;
}

void expect_same(const fs::path& a, const fs::path& b) {
  EXPECT_EQ(names_in(a), names_in(b));
  for (const std::string& name : names_in(a))
    EXPECT_TRUE(name == "result.json" || name == "dynamics.state" || content(a / name) == content(b / name)) << name;
  EXPECT_EQ(numbers(a), numbers(b));
}

TEST(DynamicsRun, ThatWasStoppedGoesOnToTheSameEndBitForBit) {
  const Workspace work(long_run());
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture", "--threads", "2"}).status, 0);
  ASSERT_EQ(stopped(work, "out", 100, 9), 128 + 9) << "it was done before";
  EXPECT_FALSE(fs::exists(work / "out/result.json"));
  ASSERT_EQ(stopped(work, "out", 150, 15, true), 128 + 15) << "it was done before";
  EXPECT_EQ(names_in(work / "out"), (std::set<std::string>{"unfinished"})) << "nothing else is left behind";
  const auto done = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
  ASSERT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, HasSubstr("goes on from step"));
  expect_same(work / "whole", work / "out");
}

TEST(DynamicsRun, WithRigidBodiesGoesOnToTheSameEndBitForBitToo) {
  const Workspace work(replaced(between_rigid_bodies, "mesh_size = 0.25", "mesh_size = 0.1"));
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture"}).status, 0);
  const auto limited = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--time-limit", "0.02"});
  EXPECT_EQ(limited.status, 3);
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"}).status, 0);
  expect_same(work / "whole", work / "out");
}

TEST(DynamicsRun, ATimeLimitStopsItAndAResumedOneEndsAllTheSame) {
  const Workspace work(long_run());
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "whole", "--no-picture"}).status, 0);
  const auto limited = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--time-limit", "0.05"});
  EXPECT_EQ(limited.status, 3);
  EXPECT_THAT(limited.output, HasSubstr("--resume continues it"));
  EXPECT_TRUE(fs::exists(work / "out/failure.json"));
  ASSERT_EQ(work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"}).status, 0);
  expect_same(work / "whole", work / "out");
  // One that ended goes further.
  work.write("case.toml", replaced(long_run(), "end = 12", "end = 13"));
  const auto further = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
  ASSERT_EQ(further.status, 0) << further.output;
  EXPECT_EQ(json(work / "out/result.json")["time"], 13.0);
  EXPECT_EQ(column(work / "out/history.csv", "t").front(), 0.0);
}

TEST(DynamicsRun, CheckpointsOfOtherCasesAndDamagedOnesAreRefused) {
  const Workspace work(rubber);
  const auto refuses = [&](const std::string& why) {
    const auto done = work.efree({"run", "case.toml", "--out", "out", "--no-picture", "--resume"});
    EXPECT_EQ(done.status, 2) << done.output;
    EXPECT_THAT(done.output, HasSubstr(why));
  };
  refuses("no steps of an earlier run");
  ASSERT_EQ(run(work, rubber).status, 0);
  work.write("case.toml", with("density = 1", "density = 2"));
  refuses("of another case");
  work.write("case.toml", rubber + "[dynamics]\ncourant = 0.4\n");
  refuses("of another case");
  work.write("case.toml", with("end = 4", "end = 2"));
  refuses("end is 2, and the steps of the earlier run are at 4 already");
  work.write("case.toml", rubber);
  const std::string whole = content(work / "out/dynamics.state");
  for (const std::size_t at : {whole.size() / 2, whole.size() - 20}) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] + 1);
    work.write("out/dynamics.state", damaged);
    refuses("damaged");
  }
  work.write("out/dynamics.state", whole.substr(0, whole.size() / 2));
  refuses("damaged");
  work.write("out/dynamics.state", "other");
  refuses("expected the steps");
}

TEST(DynamicsRun, ExamplesOfTheMaterialPointMethodBegin) {
  // The strip has little energy in its first steps, in which its ends take hold.
  for (const auto& [name, steps] : {std::pair("torn_sheet", 3), std::pair("pressed_block", 3),
                                    std::pair("twisted_bar", 3), std::pair("stretched_strip", 40)}) {
    const auto any = read_case(fs::path(EFREE_EXAMPLES) / "mpm" / (std::string(name) + ".toml"));
    std::visit(
        [&, name = name, steps = steps](const auto& example) {
          if constexpr (requires { example.mpm; }) {
            auto model = build_dynamics_model(example);
            for (int k = 0; k < steps; ++k) model.dynamics.step();
            EXPECT_LT(std::abs(model.dynamics.energy().error()), 1e-2) << name;
          }
        },
        any);
  }
}

TEST(DynamicsRun, TaylorBarOfTheExamplesEndsInTheBandsOfPublishedComputations) {
  const Workspace workspace;
  const auto done = run(workspace, content(fs::path(EFREE_EXAMPLES) / "impact/taylor_bar.toml"));
  ASSERT_EQ(done.status, 0) << done.output;
  const auto result = json(workspace / "out/result.json");
  EXPECT_GT(result["probes"]["length"].get<double>(), 21.4e-3);
  EXPECT_LT(result["probes"]["length"].get<double>(), 21.7e-3);
  EXPECT_GT(result["probes"]["foot"].get<double>(), 6.9e-3);
  EXPECT_LT(result["probes"]["foot"].get<double>(), 7.3e-3);
  EXPECT_EQ(result["probes"]["plastic strain"], result["extremes"]["equivalent_plastic_strain"]["max"]["value"]);
  EXPECT_LT(std::abs(result["energy"]["largest_error"].get<double>()), 0.01);
}

}  // namespace
}  // namespace efree
