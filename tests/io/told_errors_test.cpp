// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of probes, reactions and extremes against closed forms.
#include "efree/tests/io/solved.hpp"

#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using test::json, test::replaced, test::solved, test::Workspace;
using ::testing::HasSubstr;

std::string with_basis(const std::string& kind) {
  return fmt::format("[basis]\nkind = \"{}\"\n", kind);
}

/// The pole of the hole moves by -1, the point of the hole on the axis of tension by 3.
const std::string probed_plate =
    replaced(test::plate, "[analysis]\n", "[analysis]\nextremes = [\"displacement\", \"von_mises\"]\n") + R"([[probe]]
name = "pole"
at = [0, 1]
[[probe]]
name = "equator"
at = [1, 0]
[[reaction]]
name = "foot"
on = "bottom"
)";

/// Chords of 0.2 stand for the arc: 0.009 at the equator, more than all else with quadratic cells.
TEST(ToldErrors, OfDisplacementsAtAHoleAreHalfToTwiceTheTruth) {
  for (const char* kind : {"p1", "p2", "mls"}) {
    const auto result = solved(probed_plate + with_basis(kind));
    for (const auto& [name, values] : result.probes) {
      const int axis = name == "pole" ? 1 : 0;
      const double truth = std::abs(values.displacement[axis] - (name == "pole" ? -1.0 : 3.0));
      const double said = result.probe_errors.at(name)[axis];
      EXPECT_GT(said, 0.5 * truth) << kind << " " << name;
      EXPECT_LT(said, 2.0 * truth) << kind << " " << name;
    }
  }
}

/// A dual solution serves all of them; what is said of each is what would be said of it alone.
TEST(ToldErrors, OfLoadCasesAreThoseOfEachAlone) {
  const std::string body =
      "[geometry]\nshape = \"rectangle\"\nparameters = { width = 2, height = 1 }\nmesh_size = 0.1\n"
      "[analysis]\nplane = \"stress\"\nextremes = [\"displacement\", \"von_mises\"]\n"
      "[material]\nE = 1\nnu = 0.3\n[[boundary]]\non = \"left\"\ndisplacement = [0, 0]\n"
      "[[boundary]]\non = \"bottom\"\ndisplacement = [\"free\", 0]\n"
      "[[probe]]\nname = \"corner\"\nat = [2, 1]\n[[reaction]]\nname = \"wall\"\non = \"left\"\n";
  const std::string pulled = "on = \"right\"\ntraction = [1, 0]\n", sheared = "on = \"top\"\ntraction = [\"x\", 1]\n";
  for (const std::string& method : {with_basis("p1"), with_basis("p2"), std::string("[cloud]\nspacing = 0.3\n")}) {
    const auto both = solved(body + method + "[[case]]\nname = \"a\"\n[[case.boundary]]\n" + pulled +
                             "[[case]]\nname = \"b\"\n[[case.boundary]]\n" + sheared);
    const auto alone = solved(body + method + "[[boundary]]\n" + sheared);
    const Answer<2>& of = both.more.at(0);
    const Vec<2> said = of.probe_errors.at("corner"), expected = alone.probe_errors.at("corner");
    EXPECT_GT(expected.minCoeff(), 0.0) << method;
    EXPECT_LT((said - expected).norm(), 0.05 * expected.norm()) << method;
    ASSERT_EQ(of.reactions.size(), 1u);
    EXPECT_LT((of.reactions[0].force - alone.reactions[0].force).norm(), 1e-3) << method;
    EXPECT_LT((of.reactions[0].error - alone.reactions[0].error).norm(), 0.05 * alone.reactions[0].error.norm() + 1e-9)
        << method;
    for (std::size_t k = 0; k < 2; ++k) {
      ASSERT_TRUE(of.extremes[k].error && both.extremes[k].error);
      EXPECT_NEAR(*of.extremes[k].error, *alone.extremes[k].error, 0.05 * *alone.extremes[k].error) << method;
      EXPECT_GT(std::abs(*of.extremes[k].error - *both.extremes[k].error), 0.1 * *of.extremes[k].error) << method;
    }
  }
}

/// Equilibrium alone says what the foot carries: the tractions' resultant, with any mesh.
TEST(ToldErrors, AReactionThatEquilibriumDeterminesIsExactAndSaidToBe) {
  for (const char* kind : {"p1", "p2", "mls"}) {
    const auto result = solved(probed_plate + with_basis(kind));
    ASSERT_EQ(result.reactions.size(), 1u);
    EXPECT_NEAR(result.reactions[0].force.y(), 0.1171875, 1e-6) << kind;
    EXPECT_EQ(result.reactions[0].force.x(), 0.0) << kind;
    EXPECT_LT(result.reactions[0].error.norm(), 1e-9) << kind;
  }
}

TEST(ToldErrors, OfACloudThatIsNotCorrectedCoverItsDistanceToTheFiniteElements) {
  const auto bare = solved(replaced(probed_plate, "plane = \"stress\"", "plane = \"stress\"\ncorrection = \"off\""));
  const double truth = std::abs(bare.probes[0].second.displacement.y() + 1.0);
  EXPECT_GT(truth, 0.05);
  EXPECT_NEAR(bare.probe_errors.at("pole").y(), truth, 0.2 * truth);
}

TEST(ToldErrors, OfTheLargestStressAndDisplacementOfThePlate) {
  for (const char* kind : {"p1", "p2", "mls"}) {
    const auto result = solved(probed_plate + with_basis(kind));
    ASSERT_EQ(result.extremes.size(), 2u);
    EXPECT_LT((result.extremes[0].at - Vec<2>(4.0, 0.0)).norm(), 1e-12);
    // Kirsch: ((1 - nu) r + (1 + nu) / r + (1 + nu) r + 4 / r - (1 + nu) / r^3) / 2 at r = 4; chords take 0.01 at most.
    EXPECT_NEAR(result.extremes[0].value, 4.6523, *result.extremes[0].error + 0.01) << kind;
    EXPECT_LT(*result.extremes[0].error, 0.05) << kind;
    EXPECT_EQ(result.extremes[1].of, "von_mises");
    EXPECT_NEAR(result.extremes[1].value, 3.0, *result.extremes[1].error) << kind;
    EXPECT_LT(*result.extremes[1].error, 1.0) << kind;
  }
}

TEST(ToldErrors, OfExtremesAreKnownInCasesWithoutProbes) {
  const std::string bare = probed_plate.substr(0, probed_plate.find("[[probe]]"));
  for (const char* kind : {"p1", "mls"})
    for (const auto& extreme : solved(bare + with_basis(kind)).extremes) EXPECT_TRUE(extreme.error.has_value()) << kind;
}

/// Fields in the space of the elements: nothing is left, and that is a number. Of a stress that varies, recovery takes
/// the mean in corners with a single cell, so that a little is said of bending.
TEST(ToldErrors, OfUniformTensionAreZeroAndOfPureBendingNextToIt) {
  const std::string strip = R"([geometry]
shape = "rectangle"
parameters = { width = 2, height = 1, y = -0.5 }
mesh_size = 0.3
[analysis]
plane = "stress"
extremes = ["displacement", "von_mises"]
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, "-0.3*y"]
[[boundary]]
on = "right"
traction = [1, 0]
[[probe]]
name = "tip"
at = [2, 0]
[[reaction]]
name = "wall"
on = "left"
)";
  const std::string bending = replaced(replaced(strip, "\"-0.3*y\"", "\"-0.15*y^2\""), "[1, 0]", "[\"y\", 0]");
  for (const char* kind : {"p1", "p2", "mls"})
    for (const bool bends : {false, true}) {
      if (bends && std::string(kind) != "p2") continue;
      const auto result = solved((bends ? bending : strip) + with_basis(kind));
      const Vec<2> tip = bends ? Vec<2>(0.0, -2.0) : Vec<2>(2.0, 0.0);
      const Vec<2> wall = bends ? Vec<2>(0.0, 0.0) : Vec<2>(-1.0, 0.0);
      const double small = std::string(kind) == "mls" ? 1e-3 : 1e-10;  // iterations end at a per cent
      EXPECT_LT((result.probes[0].second.displacement - tip).norm(), small) << kind;
      EXPECT_LT((result.reactions[0].force - wall).norm(), small) << kind;
      EXPECT_LT(result.reactions[0].error.norm(), small) << kind;
      const double said = bends ? 1e-3 : small;
      EXPECT_LT(result.probe_errors.at("tip").norm(), said) << kind;
      // Bending has the same stress all along its edges: rounding says where it is read, next to corners or not. A
      // mean in a corner's cell is off by the gradient of the stress, 1, times two thirds of an edge at most.
      for (const auto& extreme : result.extremes)
        EXPECT_LT(*extreme.error, bends && extreme.of == "von_mises" ? 2.0 / 3.0 * 0.3 : 20.0 * said) << kind;
      EXPECT_LT(result.error_density.maxCoeff(), bends ? 0.05 : small) << kind;
    }
}

/// A wall whose inner face is pushed outwards: by the pressure of Lame (1852) times its area.
TEST(ToldErrors, OfTheForceThatWidensAThickCylinder) {
  const std::string cylinder = R"([geometry]
shape = "rectangle"
parameters = { width = 1, height = 1, x = 1 }
mesh_size = 0.25
[analysis]
plane = "axisymmetric"
[material]
E = 1
nu = 0.3
[[boundary]]
on = "bottom"
displacement = ["free", 0]
[[boundary]]
on = "top"
displacement = ["free", 0]
[[boundary]]
on = "left"
displacement = [0.01, "free"]
[[reaction]]
name = "inner"
on = "left"
)";
  const double a = 1.0, b = 2.0, nu = 0.3;
  const double pressure = 0.01 * (b * b - a * a) / ((1.0 + nu) * a * ((1.0 - 2.0 * nu) * a * a + b * b));
  const double force = pressure * 2.0 * std::numbers::pi * a;
  for (const char* kind : {"p1", "p2", "mls"}) {
    const auto result = solved(cylinder + with_basis(kind));
    const double truth = std::abs(result.reactions[0].force.x() - force), said = result.reactions[0].error.x();
    // The dilatation is constant and the elements are better than their order, which recovery does not know.
    const double little = std::string(kind) == "p1" ? 0.005 : 2e-4;
    EXPECT_LT(truth, little * force) << kind;
    EXPECT_GT(said, 0.5 * truth) << kind;
    // Iterations leave a product of two errors of up to a per cent.
    EXPECT_LT(said, (little + 1e-4) * force) << kind;
  }
}

/// Bent by a displaced end: 3 E I / L^3 with Timoshenko's shear; linear triangles are far too stiff, and say so.
TEST(ToldErrors, OfTheForceThatBendsACantilever) {
  const std::string beam = R"([geometry]
shape = "rectangle"
parameters = { width = 10, height = 1 }
mesh_size = 0.5
[analysis]
plane = "stress"
[material]
E = 1
nu = 0
[[boundary]]
on = "left"
displacement = [0, 0]
[[boundary]]
on = "right"
displacement = ["free", -1]
[[reaction]]
name = "end"
on = "right"
[[reaction]]
name = "root"
on = "left"
)";
  const double force = -1.0 / (4000.0 / 1.0 + 1.2 * 10.0 / 0.5);
  for (const char* kind : {"p1", "p2", "mls"}) {
    const auto result = solved(beam + with_basis(kind));
    const auto &end = result.reactions[0], &root = result.reactions[1];
    const double truth = std::abs(end.force.y() / force - 1.0), said = end.error.y() / std::abs(end.force.y());
    if (std::string(kind) == "p1") {
      EXPECT_GT(truth, 0.2);
      EXPECT_GT(said, 0.5 * truth);
      EXPECT_LT(said, 2.0 * truth);
    } else {
      EXPECT_LT(truth, 0.005) << kind;
      EXPECT_LT(said, 0.01) << kind;
    }
    EXPECT_NEAR((end.force + root.force).norm(), 0.0, 1e-3 * std::abs(force)) << kind;
  }
}

/// A block clamped on two sides that meet, strongly and weakly: what both hold balances the load, and the share of
/// each is that of a mesh ten times as fine.
TEST(ToldErrors, OfReactionsOfPartsThatMeetAreHonestHoweverTheyAreHeld) {
  const std::string block = R"([geometry]
shape = "rectangle"
parameters = { width = 2, height = 1 }
mesh_size = 0.1
[analysis]
plane = "stress"
essential = "strong"
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, 0]
[[boundary]]
on = "bottom"
displacement = [0, 0]
[[boundary]]
on = "top"
traction = [0.3, -1]
[[reaction]]
name = "left"
on = "left"
[[reaction]]
name = "bottom"
on = "bottom"
)";
  const Vec<2> left(-0.3157, 0.2919), bottom(-0.2843, 1.7081);
  for (const char* kind : {"p1", "p2"})
    for (const char* essential : {"strong", "nitsche"}) {
      const auto result = solved(replaced(block, "\"strong\"", fmt::format("\"{}\"", essential)) + with_basis(kind));
      const auto &one = result.reactions[0], &other = result.reactions[1];
      EXPECT_LT((one.force + other.force - Vec<2>(-0.6, 2.0)).norm(), 1e-9) << kind << essential;
      EXPECT_LT((one.force - left).norm(), 3.0 * one.error.norm()) << kind << essential;
      EXPECT_LT((other.force - bottom).norm(), 3.0 * other.error.norm()) << kind << essential;
      EXPECT_LT(one.error.norm(), 0.03 * left.norm()) << kind << essential;
    }
}

TEST(ToldErrors, FieldIsTheErrorOfTheMeshInAllAndLargestAtTheHole) {
  const auto result = solved(probed_plate + "[basis]\ninterpolation = 1\n");
  const FineMesh<2>& mesh = *result.mesh;
  Index worst = 0;
  result.error_density.maxCoeff(&worst);
  EXPECT_LT(mesh.centroid(worst).norm(), 1.5);
  const double in_all = std::sqrt(result.error_density.cwiseAbs2().dot(mesh.volumes()) / mesh.volumes().sum());
  EXPECT_NEAR(in_all, result.estimates->mesh, 0.01 * in_all);
}

TEST(ToldErrors, GoalsAreReachedWhereTheyAreAskedFor) {
  for (const double wanted : {0.02, 0.005}) {
    const auto result =
        solved(probed_plate + fmt::format("[accuracy]\nprobes.pole = {}\nreactions.foot = 0.01\n", wanted));
    EXPECT_LE(result.probe_errors.at("pole").norm(), wanted);
    EXPECT_NEAR(result.probes[0].second.displacement.y(), -1.0, wanted);
    EXPECT_FALSE(result.attempts.empty());
    EXPECT_LE(result.attempts.back().excess, 1.0);
    EXPECT_TRUE(result.warnings.empty());
  }
}

TEST(ToldErrors, GoalsThatAreMissedAreSaid) {
  const auto result = solved(replaced(probed_plate, "half_width = 4 }", "half_width = 4 }\nmesh_size = 1") +
                             "[accuracy]\nprobes.pole = 0.0001\n");
  ASSERT_FALSE(result.warnings.empty());
  EXPECT_THAT(result.warnings.back(), HasSubstr("of the probe \"pole\" was asked for"));
}

TEST(ToldErrors, OfNamesThatTheCaseDoesNotHaveAreRefusedWithOneMessage) {
  const auto refused = [](const std::string& text) {
    const Workspace work(text);
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--quiet"});
    EXPECT_EQ(run.status, 2);
    EXPECT_FALSE(std::filesystem::exists(work / "out"));
    return run.output;
  };
  EXPECT_THAT(refused(probed_plate + "[accuracy]\nprobes.pol = 0.02\n"), HasSubstr("did you mean \"pole\"?"));
  EXPECT_THAT(refused(probed_plate + "[accuracy]\nreactions.left = 0.02\n"), HasSubstr("unknown key \"left\""));
  EXPECT_THAT(refused(probed_plate + "[accuracy]\nprobes.pole = 2\n"), HasSubstr("pole is 2, expected a number"));
  EXPECT_THAT(refused(probed_plate + "[[reaction]]\nname = \"free\"\non = \"top\"\n"),
              HasSubstr("no displacement is prescribed on \"top\""));
  EXPECT_THAT(refused(replaced(probed_plate, "\"von_mises\"]", "\"stress\"]")),
              HasSubstr("expected \"displacement\" or"));
}

TEST(ToldErrors, AreWrittenAndPrintedNextToTheirValues) {
  const Workspace work(probed_plate);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("probe \"pole\": displacement ("));
  EXPECT_THAT(run.output, HasSubstr("reaction \"foot\": force ("));
  EXPECT_THAT(run.output, HasSubstr("largest von Mises stress "));
  const auto result = json(work / "out/result.json");
  EXPECT_EQ(result["probes"]["pole"]["error"].size(), 2u);
  EXPECT_EQ(result["reactions"]["foot"]["force"].size(), 2u);
  EXPECT_EQ(result["reactions"]["foot"]["error"].size(), 2u);
  EXPECT_GT(result["extremes"]["displacement"]["error"], 0.0);
  EXPECT_LT(result["estimates"]["probes"]["pole"], 0.02);
  EXPECT_LT(result["estimates"]["extremes"]["displacement"], 0.01);
  EXPECT_GT(result["seconds"]["duals"], 0.0);
}

/// A cube of voxels with a ball of void in a corner, its top pulled up: three grids against ones twice as fine.
TEST(ToldErrors, OnCellsAreThoseOfTheGrids) {
  const std::string cube = R"([geometry]
file = "ball.raw"
mesh_size = 2
[geometry.image]
raw = { size = [24, 24, 24], type = "uint8" }
[analysis]
extremes = ["displacement"]
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, "free", "free"]
[[boundary]]
on = "front"
displacement = ["free", 0, "free"]
[[boundary]]
on = "bottom"
displacement = ["free", "free", 0]
[[boundary]]
on = "top"
displacement = ["free", "free", 0.24]
[[probe]]
name = "side"
at = [23.9, 23.9, 12]
[[reaction]]
name = "head"
on = "top"
[[reaction]]
name = "foot"
on = "bottom"
)";
  const auto on_grid = [&](const std::string& size, double radius) {
    const Workspace work(replaced(cube, "mesh_size = 2", "mesh_size = " + size));
    std::ofstream image(work / "ball.raw", std::ios::binary);
    for (int p = 0; p < 24 * 24 * 24; ++p) {
      const double x = p % 24 + 0.5, y = p / 24 % 24 + 0.5, z = p / 24 / 24 + 0.5;
      image.put(std::sqrt(x * x + y * y + z * z) < radius ? 0 : 1);
    }
    image.close();
    const auto analysis = std::get<Case<3>>(read_case(work / "case.toml"));
    return analyse_image(analysis).value();
  };
  const auto coarse = on_grid("2", 12.0), fine = on_grid("0.5", 12.0);
  for (const std::size_t r : {0u, 1u}) {
    const double truth = std::abs(coarse.reactions[r].force.z() - fine.reactions[r].force.z());
    EXPECT_GT(coarse.reactions[r].error.z(), 0.5 * truth);
    EXPECT_LT(coarse.reactions[r].error.z(), 3.0 * truth);
  }
  EXPECT_NEAR(coarse.reactions[0].force.z() + coarse.reactions[1].force.z(), 0.0, 2e-3 * coarse.reactions[0].force.z());
  // What is pulled in by nothing but the end that moves: twice the energy over the displacement.
  EXPECT_NEAR(coarse.reactions[0].force.z(), 2.0 * coarse.solution.strain_energy / 0.24,
              2e-3 * coarse.reactions[0].force.z());
  const Vec<3> distance = (coarse.probes[0].second.displacement - fine.probes[0].second.displacement).cwiseAbs();
  EXPECT_GT(coarse.probe_errors.at("side").norm(), 0.5 * distance.norm());
  EXPECT_LT(coarse.probe_errors.at("side").norm(), 0.02 * coarse.probes[0].second.displacement.norm());
  EXPECT_TRUE(coarse.extremes[0].error.has_value());
  // Without a pore the strain is uniform and every grid exact.
  const auto whole = on_grid("2", 0.0);
  EXPECT_NEAR(whole.reactions[0].force.z(), 0.01 * 24 * 24, 1e-3);
  EXPECT_LT(whole.reactions[0].error.norm(), 1e-3 * whole.reactions[0].force.z());
}

/// A tube under pressure inside, held by soft springs.
std::string tube(double inner, double outer, const std::string& size) {
  return fmt::format(
      "[geometry]\nshape = \"annulus\"\nparameters = {{ inner = {}, outer = {} }}\n{}"
      "[analysis]\nplane = \"strain\"\nextremes = [\"von_mises\"]\n[material]\nE = 1e5\nnu = 0.3\n"
      "[[boundary]]\non = \"inner\"\npressure = 1\n[[boundary]]\non = \"outer\"\nstiffness = 1e-3\n"
      "[[probe]]\nname = \"bore\"\nat = [{}, 0]\n",
      inner, outer, size, inner);
}
/// Strain energy of it (Lame): half the work of the pressure on the bore as it opens.
double energy_of_tube(double inner, double outer) {
  const double E = 1e5, nu = 0.3, a = inner * inner, b = outer * outer;
  return std::numbers::pi * inner * (1.0 + nu) * a / (E * (b - a)) * inner * (1.0 - 2.0 * nu + b / a);
}

TEST(FacetErrors, AThinTubeHasLamesStressesByDefault) {
  const auto result = solved(tube(9.8, 10.0, ""));
  EXPECT_NEAR(result.extremes[1].value, 44.0, 4.4);
  EXPECT_GT(result.estimates->geometry, 0.0);
  EXPECT_GT(result.estimates->total(), result.estimates->geometry);
  const double truth = energy_of_tube(9.8, 10.0);
  EXPECT_NEAR(result.solution.strain_energy, truth, 0.01 * truth);
  EXPECT_TRUE(result.warnings.empty());
}

/// 44 becomes two hundred.
TEST(FacetErrors, AThinTubeOfFewFacetsIsWarnedOf) {
  const auto result = solved(tube(9.8, 10.0, "mesh_size = 3\n"));
  EXPECT_GT(*result.extremes[1].error, 0.5 * std::abs(result.extremes[1].value - 44.0));
  EXPECT_THAT(result.warnings, ::testing::Contains(HasSubstr("stresses in the wall around")));
}

TEST(FacetErrors, AreReachedWhenAnAccuracyIsAskedFor) {
  for (const double wanted : {0.05, 0.01}) {
    const auto result = solved(tube(1.0, 2.0, "") + fmt::format("[accuracy]\nenergy = {}\n", wanted));
    const double truth = energy_of_tube(1.0, 2.0);
    EXPECT_LE(std::sqrt(std::abs(result.solution.strain_energy / truth - 1.0)), wanted);
    EXPECT_LE(result.estimates->total(), wanted);
    EXPECT_TRUE(result.warnings.empty());
  }
}

TEST(FacetErrors, AreInTheErrorsOfProbes) {
  const auto result = solved(tube(1.0, 2.0, "mesh_size = 0.5\n") + with_basis("p2"));
  const double truth = energy_of_tube(1.0, 2.0) / std::numbers::pi;
  const double off = std::abs(result.probes[0].second.displacement.x() - truth);
  EXPECT_GT(result.probe_errors.at("bore").x(), 0.5 * off);
  EXPECT_LT(result.probe_errors.at("bore").x(), 2.5 * off);
}

/// The pole and the equator of a hole whose chords are 0.009 off.
TEST(FacetErrors, FirstOrderTakesMostOfThemOffDisplacementsAtAHole) {
  for (const char* kind : {"p2", "mls"}) {
    const auto result = solved(probed_plate + with_basis(kind));
    ASSERT_TRUE(result.on_surface.has_value());
    for (const auto& [name, values] : result.probes) {
      const int axis = name == "pole" ? 1 : 0;
      const double truth = name == "pole" ? -1.0 : 3.0;
      const WithError<Vec<2>>& at = result.on_surface->probes.at(name);
      const double off = std::abs(at.value[axis] - truth);
      EXPECT_LT(off, at.error[axis]) << kind << " " << name;
      EXPECT_LT(at.error[axis], result.probe_errors.at(name)[axis]) << kind << " " << name;
      if (name == "equator") EXPECT_LT(off, 0.3 * std::abs(values.displacement[axis] - truth)) << kind;
    }
  }
}

/// An eighth of a sphere under pressure inside (Lame); half the work of the pressure as the bore opens.
TEST(FacetErrors, FirstOrderTakesMostOfThemOffTheEnergyOfASphere) {
  const double nu = 0.3, opening = (1.0 - 2.0 * nu + 4.0 * (1.0 + nu)) / 7.0, truth = std::numbers::pi * opening / 4.0;
  std::string sphere =
      "[geometry]\nshape = \"thick_sphere\"\nparameters = { inner = 1, outer = 2 }\nmesh_size = 0.4\n[basis]\nkind = "
      "\"p2\"\n[material]\nE = 1\nnu = 0.3\n[[boundary]]\non = \"inner\"\npressure = 1\n";
  for (const char* plane : {"left", "front", "bottom"})
    sphere += fmt::format("[[boundary]]\non = \"{}\"\nnormal_displacement = 0\n", plane);
  const auto result = solved<3>(sphere);
  const double before = std::abs(result.solution.strain_energy / truth - 1.0);
  EXPECT_GT(before, 0.01);
  ASSERT_TRUE(result.on_surface && result.on_surface->strain_energy);
  const WithError<double>& energy = *result.on_surface->strain_energy;
  const double after = std::abs(energy.value / truth - 1.0);
  EXPECT_LT(after, 0.1 * before);
  EXPECT_LT(after, energy.error / energy.value);
  EXPECT_LT(energy.error / energy.value, 0.5 * before);
}

/// No energy where springs store a part of it, and nothing at all where facets are far from the surface.
TEST(FacetErrors, FirstOrderIsNotTakenWhereItDoesNotDo) {
  const auto on_springs = solved(tube(1.0, 2.0, "mesh_size = 0.5\n") + with_basis("p2"));
  ASSERT_TRUE(on_springs.on_surface.has_value());
  EXPECT_FALSE(on_springs.on_surface->strain_energy.has_value());
  EXPECT_FALSE(solved(tube(9.8, 10.0, "mesh_size = 3\n")).on_surface.has_value());
}

/// A heavy ring on soft springs: facets change its weight, and the springs store nearly all of its energy.
TEST(FacetErrors, AreSharesOfTheEnergyOfBodyAndSprings) {
  const auto result = solved(
      "[geometry]\nshape = \"annulus\"\nparameters = { inner = 1, outer = 2 }\nmesh_size = 0.5\n[basis]\nkind = "
      "\"p2\"\n"
      "[analysis]\nplane = \"strain\"\nbody_force = [0, -1]\n[material]\nE = 1e5\nnu = 0.3\n"
      "[[boundary]]\non = \"outer\"\nstiffness = 1e-2\n");
  double length = 0.0;
  for (const Index f : result.mesh->group("outer")) length += result.mesh->facet_measure(f);
  const double weight = result.mesh->volumes().sum(), stored = weight * weight / length;
  const double truth = std::pow(3.0 * std::numbers::pi, 2.0) / (4.0 * std::numbers::pi);
  const double off = std::sqrt(std::abs(truth / stored - 1.0));
  EXPECT_GT(result.estimates->geometry, 0.5 * off);
  EXPECT_LT(result.estimates->geometry, 2.0 * off);
}

}  // namespace
}  // namespace efree
