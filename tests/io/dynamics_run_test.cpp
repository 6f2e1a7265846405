// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics from case files: results of runs.
#include "efree/tests/io/dynamics_cases.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <set>

namespace efree {
namespace {

using test::between_rigid_bodies, test::column, test::content, test::json, test::names_in, test::replaced, test::rubber,
    test::run, test::says, test::start, test::with, test::without, test::Workspace;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

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

TEST(DynamicsRun, PicturesOfSeveralFieldsAreJoinedToAnimations) {
  const Workspace workspace;
  const std::string pictures =
      "frames = 3\nanimation = \"gif\"\npictures = [{ field = \"J\" }, { name = \"up\", field = \"stress_yy\", "
      "range = [-1, 1] }]";
  workspace.write("case.toml", replaced(rubber, "frames = 3", pictures));
  const auto done = workspace.efree({"run", "case.toml", "--out", "out"});
  ASSERT_EQ(done.status, 0) << done.output;
  for (const char* name : {"frame_J_0000.png", "frame_J_0003.png", "frame_up_0003.png"})
    EXPECT_GT(fs::file_size(workspace / ("out/" + std::string(name))), 1000u) << name;
  EXPECT_FALSE(fs::exists(workspace / "out/frame_0000.png"));
  if (run_program(workspace / ".", {"ffmpeg", "-version"}) == 0)
    for (const char* name : {"animation_J.gif", "animation_up.gif"})
      EXPECT_EQ(content(workspace / ("out/" + std::string(name))).substr(0, 6), "GIF89a") << name;
  else
    EXPECT_NE(done.output.find("no animation: ffmpeg is not installed"), std::string::npos) << done.output;
  // A later run without them leaves none of them behind.
  workspace.write("case.toml", rubber);
  ASSERT_EQ(workspace.efree({"run", "case.toml", "--out", "out", "--quiet"}).status, 0);
  EXPECT_FALSE(fs::exists(workspace / "out/frame_J_0000.png"));
  EXPECT_FALSE(fs::exists(workspace / "out/animation_J.gif"));
  EXPECT_GT(fs::file_size(workspace / "out/frame_0000.png"), 1000u);

  workspace.write("case.toml", replaced(rubber, "frames = 3", "pictures = [{ field = \"heat\" }]"));
  const auto refused = workspace.efree({"run", "case.toml", "--out", "other", "--quiet"});
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.output.find("there is no field \"heat\"; the points have von_mises"), std::string::npos)
      << refused.output;
  EXPECT_FALSE(fs::exists(workspace / "other"));
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
  for (const char* contact : {"", "[otm]\nseizing = true\n", "[contact]\nenabled = false\n"}) {
    const Workspace workspace;
    write_two_squares(workspace, 0.6);
    const auto done = run(workspace, two + contact);
    if (std::string(contact).find("enabled") != std::string::npos) {
      EXPECT_EQ(done.status, 0) << done.output;
      continue;
    }
    EXPECT_EQ(done.status, 2) << done.output;
    EXPECT_THAT(done.output,
                testing::AllOf(HasSubstr("case.toml:1: bodies overlap at the start"), HasSubstr("\"one\"")));
    EXPECT_FALSE(fs::exists(workspace / "out"));
  }
  {
    const Workspace workspace;
    write_two_squares(workspace, 0.95);  // by less than points would show
    const auto done = run(workspace, two);
    EXPECT_EQ(done.status, 2) << done.output;
    EXPECT_THAT(done.output, testing::AllOf(HasSubstr("is inside region"), HasSubstr("by 0.05 at (")));
  }
  const Workspace workspace;
  write_two_squares(workspace, 1.0);  // side by side
  const std::string J = "[[probe]]\nname = \"J\"\nsmallest = \"J\"\n";
  EXPECT_EQ(run(workspace, two + J).status, 0);
  EXPECT_NEAR(json(workspace / "out/result.json")["probes"]["J"].get<double>(), 1.0, 1e-12);
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

TEST(DynamicsRun, SpeedsThatOnlyMixedUnitsExplainAreWarnedOf) {
  const Workspace workspace;
  EXPECT_THAT(run(workspace, replaced(rubber, "\"-0.2\"", "\"-20\"")).output, HasSubstr("are units mixed?"));
  EXPECT_THAT(run(workspace, rubber).output, testing::Not(HasSubstr("are units mixed?")));
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
