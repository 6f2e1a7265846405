// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics from case files: errors of input, and what a case says of bodies.
#include "efree/tests/io/dynamics_cases.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using test::refuses, test::replaced, test::rubber, test::run, test::says, test::with, test::without, test::Workspace;
namespace fs = std::filesystem;

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
  EXPECT_THAT(forced("gravity = [0, \"log(x - 1)\"]"), says("log(x - 1)"));
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
  EXPECT_THAT(refuses(with("extent = \"y\"", "largest = \"temperature\"")), says("von_mises"));
  EXPECT_THAT(refuses(with("frames = 3", "colour = \"red\"")), says("colour in [output] is no longer known"));
  EXPECT_THAT(refuses(with("frames = 3", "animation = \"avi\"")), says("webm"));
  EXPECT_THAT(refuses(with("frames = 3", "pictures = [{ field = \"J\", view = [0, 0] }]")), says("view"));
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
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nneighbourhood = 2\n"),
              says("expected toughness, stretch, strain or spall"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\ntoughness = -1\n"), says("toughness"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nregion = \"bolt\"\nstretch = 2\n"), says("bolt"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstretch = 2\n[[fracture]]\nstretch = 3\n"), says("fracture already"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = { D1 = 1, D6 = 2 }\n"), says("D6"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = 0.2\n"), says("strain is 0.2, expected an array of pairs"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = [[0.3, 0.5], [0, 1]]\n"),
              says("strain: triaxiality 0 of a table after 0.3, expected ascending values"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = [[0, 1], [0.3, 0]]\n"),
              says("strain: plastic strain at failure = 0, expected a positive number"));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nstrain = [[0, 1]]\n"),
              says("the material has no plastic strain: expected one such as \"j2\""));
  EXPECT_THAT(refuses(rubber + "[[fracture]]\nspall = 0\n"), says("spall is 0, expected a number > 0"));
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
  const std::string ball = "shape = \"ball\"\nradius = 0.3\nmass = 1\n";
  EXPECT_THAT(with_rigid_body(ball + "centre = [50, 0.1]\n"), says("the rigid body reaches through a wall by 0.1"));
  EXPECT_THAT(with_rigid_body(ball + "centre = [50, 9]\n[[rigid_body]]\n" + ball + "centre = [50, 9.4]\n"),
              says("the rigid body reaches into another one by 0.2"));
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

TEST(DynamicsCase, FractureIsAsTheCaseSays) {
  const auto criteria = [](const std::string& entry) {
    const Workspace workspace(rubber + "[[fracture]]\n" + entry);
    return std::get<DynamicsCase<2>>(read_case(workspace / "case.toml")).fractures.at(0).criteria;
  };
  const FractureCriteria table = criteria("strain = [[0, 1], [0.5, 0.2]]\nspall = 3\n");
  EXPECT_EQ(table.spall, 3.0);
  EXPECT_DOUBLE_EQ(table.strain->at(0.25, 1.0, 0.0), 0.6);
  EXPECT_DOUBLE_EQ(criteria("strain = { D1 = 0.1, D2 = 0.2, D3 = -1 }\n").strain->at(0.5, 1.0, 0.0),
                   0.1 + 0.2 * std::exp(-0.5));
  EXPECT_TRUE(criteria("spall = 3\n").on());
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

}  // namespace
}  // namespace efree
