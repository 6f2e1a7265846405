// SPDX-License-Identifier: GPL-3.0-or-later
/// Reactions, resultants of loads and their balance; loads by resultant, forces per mass, elastic supports.
#include "efree/tests/io/solved.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>

namespace efree {
namespace {

using test::json, test::replaced, test::solved, test::Workspace;
using ::testing::HasSubstr;

std::string with(const std::string& text, const std::string& analysis, const std::string& basis = "") {
  const std::string said = text.find("[analysis]\n") == std::string::npos
                               ? text + "[analysis]\n" + analysis + "\n"
                               : replaced(text, "[analysis]\n", "[analysis]\n" + analysis + "\n");
  return basis.empty() ? said : said + "[basis]\n" + basis + "\n";
}

/// Held on an arc, on a side and on springs; a force with a moment. Nothing is symmetric.
const std::string plate = R"([geometry]
shape = "plate_with_hole"
parameters = { radius = 1, half_width = 4 }
mesh_size = 0.25
[analysis]
plane = "stress"
[material]
E = 1
nu = 0.3
density = "1 + 0.1*x"
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
displacement = [0, "0.01*x"]
[[boundary]]
on = "hole"
normal_displacement = "0.01*x"
[[boundary]]
on = "right"
force = [1, 0.3]
moment = 2
[[boundary]]
on = "right"
pressure = "0.1*y"
[[boundary]]
on = "top"
normal_stiffness = 0.5
)";
const std::string cook = R"([geometry]
shape = "cook"
mesh_size = 4
[analysis]
plane = "strain"
acceleration = [0.1, "0.01*x"]
[material]
E = 240
nu = 0.49
density = 0.02
[[boundary]]
on = "left"
displacement = [0, 0]
[[boundary]]
on = "bottom"
displacement = ["free", "0.01*x"]
[[boundary]]
on = "right"
traction = [0, 0.1]
)";
const std::string cylinder = R"([geometry]
shape = "rectangle"
parameters = { width = 1, height = 2, x = 1 }
mesh_size = 0.2
[analysis]
plane = "axisymmetric"
rotation = { speed = 0.3 }
[material]
E = 1
nu = 0.3
density = 1
[[boundary]]
on = "bottom"
displacement = [0, 0]
[[boundary]]
on = "left"
pressure = 0.1
[[boundary]]
on = "top"
force = [0, 2]
[[boundary]]
on = "right"
stiffness = [0, 0.2]
)";
const std::string box = R"([geometry]
shape = "box"
parameters = { width = 3, depth = 1, height = 1 }
mesh_size = 0.4
[cloud]
spacing = 0.6
[material]
E = 1
nu = 0.3
density = 1
[analysis]
rotation = { speed = 0.2, axis = [1, 1, 0], through = [0, 0, 5] }
acceleration = [0, 0, -0.1]
[[boundary]]
on = "left"
displacement = [0, 0, "0.01*y"]
[[boundary]]
on = "bottom"
displacement = [0, "free", "free"]
[[boundary]]
on = "front"
stiffness = 0.1
[[boundary]]
on = "right"
force = [0.1, 0.2, -0.3]
moment = [0.1, 0.2, 0.3]
at = [5, 5, 5]
)";
/// Two regions tied along x = 1, the right one nearly incompressible.
const std::string layers = R"([geometry]
file = "layers.geo"
mesh_size = 0.15
[analysis]
plane = "strain"
[[material]]
region = "one"
E = 1
nu = 0.3
[[material]]
region = "other"
E = 10
nu = 0.495
[[boundary]]
on = "left"
displacement = [0, 0]
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
traction = [0.1, 0.2]
)";
const std::string layers_geo = R"(Point(1) = {0, 0, 0};
Point(2) = {1, 0, 0};
Point(3) = {2, 0, 0};
Point(4) = {2, 1, 0};
Point(5) = {1.2, 1, 0};
Point(6) = {0, 1, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 5};
Line(5) = {5, 6};
Line(6) = {6, 1};
Line(7) = {2, 5};
Curve Loop(1) = {1, 7, 5, 6};
Curve Loop(2) = {2, 3, 4, -7};
Plane Surface(1) = {1};
Plane Surface(2) = {2};
Physical Curve("bottom") = {1, 2};
Physical Curve("right") = {3};
Physical Curve("left") = {6};
Physical Surface("one") = {1};
Physical Surface("other") = {2};
)";

/// The sums by hand, and that they are not nothing.
template <int Dim> void expect_balance(const Result<Dim>& result, const std::string& what) {
  Resultant<Dim> loads, reactions;
  double size = 0.0;
  for (const auto& load : result.balance.loads) loads += load.of, size += load.of.force.norm();
  for (const auto& [part, of] : result.balance.reactions) reactions += of, size += of.force.norm();
  EXPECT_GT(reactions.force.norm(), 0.01 * size) << what;
  for (int i = Dim == 2 && result.basis().space.axisymmetric() ? 1 : 0; i < Dim; ++i)
    EXPECT_NEAR(loads.force[i], -reactions.force[i], 1e-10 * size) << what;
  EXPECT_LT((loads.moment + reactions.moment).norm(), 1e-8 * (size + loads.moment.norm())) << what;
  EXPECT_LT(result.balance.error, 1e-10) << what;
}

TEST(Reactions, BalanceTheLoadsOfAPlateHeldOnAnArcBySpringsAndBySides) {
  for (const std::string& text : {plate, with(plate, "correction = \"off\""), with(plate, "correction = 1"),
                                  with(plate, "essential = \"nitsche\"", "kind = \"p1\""),
                                  with(plate, "rotation = { speed = 0.1, through = [1, 2] }", "order = 2")}) {
    const auto result = solved(text);
    EXPECT_EQ(result.balance.reactions.size(), 4u);
    EXPECT_EQ(result.balance.reactions.at("left").force.y(), 0.0) << "it slides";
    expect_balance(result, text);
  }
}

TEST(Reactions, BalanceTheLoadsOfCooksMembraneNearlyIncompressible) {
  for (const std::string& text :
       {cook, with(cook, "correction = \"off\""), with(cook, "correction = \"off\"\nessential = \"strong\""),
        with(cook, "", "kind = \"p2\""), with(cook, "essential = \"nitsche\"", "kind = \"p2\"")})
    expect_balance(solved(text), text);
}

TEST(Reactions, BalanceTheLoadsAlongTheAxisOfABodyOfRevolution) {
  for (const std::string& text : {cylinder, with(cylinder, "correction = \"off\""), with(cylinder, "", "kind = \"p2\""),
                                  with(cylinder, "essential = \"nitsche\"", "kind = \"p2\"")}) {
    const auto result = solved(text);
    expect_balance(result, text);
    for (const auto& [part, of] : result.balance.reactions) EXPECT_EQ(of.moment[0], 0.0) << part;
    const Resultant<2>& force = result.balance.loads[1].of;
    EXPECT_EQ(result.balance.loads[1].on, "top");
    EXPECT_NEAR(force.force.y(), 2.0, 1e-12) << "of the whole turn";
  }
}

TEST(Reactions, BalanceTheLoadsOfASolidInForceAndMoment) {
  for (const std::string& text : {box, with(box, "correction = \"off\""), with(box, "", "kind = \"p2\""),
                                  with(box, "essential = \"nitsche\"", "kind = \"p1\"")})
    expect_balance(solved<3>(text), text);
}

TEST(Reactions, BalanceTheLoadsOfTiedRegions) {
  for (const std::string& text :
       {layers, with(layers, "correction = \"off\""), with(layers, "essential = \"strong\"\ncorrection = \"off\""),
        with(layers, "", "kind = \"p2\"")}) {
    const Workspace work(text);
    work.write("layers.geo", layers_geo);
    expect_balance(analyse(std::get<Case<2>>(read_case(work / "case.toml"))), text);
  }
}

/// Of finite elements that are solved exactly a dual solution says the same, where parts share nodes, too.
TEST(Reactions, OfFiniteElementsAreThoseOfTheirDualSolutions) {
  const std::string asked =
      cook + "[[reaction]]\nname = \"wall\"\non = \"left\"\n[[reaction]]\nname = \"foot\"\non = \"bottom\"\n";
  const auto result = solved(with(asked, "", "kind = \"p2\""));
  ASSERT_EQ(result.reactions.size(), 2u);
  EXPECT_LT((result.reactions[0].force - result.balance.reactions.at("left").force).norm(), 1e-9);
  EXPECT_LT((result.reactions[1].force - result.balance.reactions.at("bottom").force).norm(), 1e-9);
  EXPECT_GT(result.balance.reactions.at("bottom").force.norm(), 0.1);
}

/// Iterations that end at a per cent leave nothing out of balance, and reactions by as much as is said.
TEST(Reactions, OfACorrectedAnswerAreNearThoseOfItsElements) {
  const auto exact = solved(with(plate, "correction = 60")), near = solved(plate);
  EXPECT_LT(near.estimates->corrections, 10);
  for (const auto& [part, of] : exact.balance.reactions)
    EXPECT_LT((of.force - near.balance.reactions.at(part).force).norm(), 0.02) << part;
}

/// The uniform stress of the patch test, whatever holds it.
TEST(Reactions, OfAUniformStressAreItsTractions) {
  const std::string stretched = R"([geometry]
shape = "rectangle"
parameters = { width = 2, height = 1, x = 1 }
mesh_size = 0.3
[analysis]
plane = "stress"
[material]
E = 2
nu = 0.25
[[boundary]]
on = "left"
displacement = ["x", "-0.25*y"]
[[boundary]]
on = "right"
displacement = ["x", "-0.25*y"]
)";
  for (const std::string& text : {stretched, with(stretched, "correction = \"off\""),
                                  with(stretched, "essential = \"nitsche\"", "kind = \"p2\"")}) {
    const auto result = solved(text);
    const Resultant<2>& right = result.balance.reactions.at("right");
    EXPECT_NEAR(right.force.x(), 2.0, 1e-10);
    EXPECT_NEAR(right.force.y(), 0.0, 1e-10);
    EXPECT_NEAR(right.moment[0], -1.0, 1e-10) << "2 at a height of 0.5";
    EXPECT_NEAR(result.balance.reactions.at("left").moment[0], 1.0, 1e-10);
  }
}

TEST(Loads, ByResultantCarryItOnAnyMesh) {
  const std::string cube = R"([geometry]
shape = "box"
parameters = { width = 1, depth = 1, height = 1 }
mesh_size = 0.5
[material]
E = 1
nu = 0.3
[basis]
kind = "p1"
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = { normal = [1, 1, 1], angle = 80 }
force = [0.1, 0.2, -0.3]
moment = [1, 2, 3]
at = [0, 7, 0]
)";
  for (const char* size : {"0.5", "0.17"}) {
    const auto result = solved<3>(replaced(cube, "mesh_size = 0.5", fmt::format("mesh_size = {}", size)));
    ASSERT_EQ(result.balance.loads.size(), 1u);
    EXPECT_LT((result.balance.loads[0].of.force - Vec<3>(0.1, 0.2, -0.3)).norm(), 1e-12);
    // (0, 7, 0) x (0.1, 0.2, -0.3) = (-2.1, 0, -0.7)
    EXPECT_LT((result.balance.loads[0].of.moment - Vec<3>(1.0 - 2.1, 2.0, 3.0 - 0.7)).norm(), 1e-12);
  }
}

/// A bar pulled outside of its axis: stress F / A + M y / I (Navier 1826), and its traction is the one that is applied.
TEST(Loads, ARemoteForceOnABarBendsIt) {
  const std::string bar = R"toml([geometry]
shape = "rectangle"
parameters = { width = 4, height = 1, y = -0.5 }
mesh_size = 0.25
[analysis]
plane = "stress"
[material]
E = 1
nu = 0.25
[[boundary]]
on = "left"
displacement = ["0", "-0.25*(y + 1.5*y^2)"]
[[boundary]]
on = "right"
force = [1, 0]
at = [10, 0.25]
[exact]
displacement = ["x*(1 + 3*y)", "-0.25*(y + 1.5*y^2) - 1.5*x^2"]
stress = ["1 + 3*y", 0, 0]
)toml";
  const auto p2 = solved(bar + "[basis]\nkind = \"p2\"\n");
  EXPECT_LT(*p2.errors->l2_displacement, 1e-10);
  EXPECT_LT(*p2.errors->energy_norm, 1e-9);
  EXPECT_LT(*solved(bar).errors->l2_displacement, 0.01);
}

/// A long tube that turns (Lame 1852, with rho omega^2 r; Timoshenko & Goodier 1951, art. 32, plane strain).
TEST(Loads, RotationSpinsATube) {
  const double a = 1.0, b = 2.0, nu = 0.3, n = nu / (1.0 - nu);  // of plane strain
  const auto u = [&](double r) {
    const double stress_r = (3.0 + n) / 8.0 * (a * a + b * b - a * a * b * b / (r * r) - r * r);
    const double hoop =
        (3.0 + n) / 8.0 * (a * a + b * b + a * a * b * b / (r * r) - (1.0 + 3.0 * n) / (3.0 + n) * r * r);
    return r * (1.0 - nu * nu) * (hoop - n * stress_r);
  };
  const std::string tube = R"([geometry]
shape = "rectangle"
parameters = { width = 1, height = 0.5, x = 1 }
mesh_size = 0.1
[analysis]
plane = "axisymmetric"
rotation = { speed = 1 }
[material]
E = 1
nu = 0.3
density = 1
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "top"
normal_displacement = 0
[[probe]]
name = "inside"
at = [1, 0.25]
)";
  for (const char* kind : {"p2", "mls"}) {
    const auto result = solved(with(tube, "", fmt::format("kind = \"{}\"", kind)));
    EXPECT_NEAR(result.probes[0].second.displacement.x(), u(a), 0.003 * u(a)) << kind;
  }
}

/// A long beam on a foundation under a force: P lambda / (2 k) there, lambda^4 = k / (4 E I) (Winkler 1867).
TEST(Loads, ABeamSinksIntoItsFoundation) {
  const std::string beam = R"([geometry]
shape = "rectangle"
parameters = { width = 14, height = 0.2 }
mesh_size = 0.1
[analysis]
plane = "stress"
[material]
E = 1
nu = 0
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "left"
traction = [0, -1e-6]
[[boundary]]
on = "bottom"
stiffness = [0, 1.6666666666666667e-4]
[[probe]]
name = "under the force"
at = [0, 0.1]
[basis]
kind = "p2"
)";
  // I = 0.2^3 / 12, lambda = 0.5; half of the beam, with half of the force: 2e-7 on a side of 0.2.
  const double sinking = 4e-7 * 0.5 / (2.0 * 1.6666666666666667e-4);
  const auto result = solved(beam);
  EXPECT_NEAR(-result.probes[0].second.displacement.y(), sinking, 0.01 * sinking);
  EXPECT_NEAR(result.balance.reactions.at("bottom").force.y(), 2e-7, 1e-14);
}

TEST(Loads, SpringsThatAreVeryStiffHoldLikeSupports) {
  const std::string foot = "[[boundary]]\non = \"bottom\"\ndisplacement = [\"free\", \"0.01*x\"]\n";
  const std::string on_the_wall = with(replaced(cook, foot, ""), "", "kind = \"p2\"");
  const auto held = solved(on_the_wall),
             springs = solved(replaced(on_the_wall, "displacement = [0, 0]", "stiffness = 1e6"));
  EXPECT_NEAR(springs.solution.strain_energy, held.solution.strain_energy, 0.002 * held.solution.strain_energy);
  const Resultant<2>&wall = held.balance.reactions.at("left"), &bed = springs.balance.reactions.at("left");
  EXPECT_LT((bed.force - wall.force).norm(), 1e-8);
  EXPECT_NEAR(bed.moment[0], wall.moment[0], 1e-6);
}

/// On the same part, whatever else it is called: the springs bear all there is, nothing else is strained.
TEST(Loads, OnSpringsAreBornByThem) {
  const std::string block = R"([geometry]
shape = "box"
parameters = { width = 20, depth = 10, height = 10 }
mesh_size = 5
[material]
E = 1000
nu = 0.3
[[boundary]]
on = "top"
stiffness = 1
[[boundary]]
on = "top"
traction = [0, 0, -1]
[[probe]]
name = "foot"
at = [3, 3, 0]
)";
  const std::string load = "traction = [0, 0, -1]";
  for (const std::string& text :
       {block, replaced(block, load, "pressure = 1"), replaced(block, load, "force = [0, 0, -200]"),
        replaced(block, "on = \"top\"\ntraction",
                 "on = { plane = { point = [0, 0, 10], normal = [0, 0, 1] } }\ntraction")}) {
    const auto result = solved<3>(text);
    EXPECT_LT((result.probes[0].second.displacement - Vec<3>(0.0, 0.0, -1.0)).norm(), 1e-9) << text;
    EXPECT_NEAR(result.balance.reactions.at("top").force.z(), 200.0, 1e-6);
  }
  const auto along = solved<3>(replaced(block, "stiffness = 1", "normal_stiffness = 1") +
                               "[[boundary]]\non = \"left\"\ndisplacement = [0, 0, \"free\"]\n");
  EXPECT_LT(along.probes[0].second.displacement.z(), -0.99);
}

/// Each as if it were alone, and what is outside of the cases acts in all.
TEST(LoadCases, AreSolvedWithOneMatrixEachByItself) {
  const std::string common = plate.substr(0, plate.find("[[boundary]]\non = \"right\"")) +
                             "[[boundary]]\non = \"top\"\nnormal_stiffness = 0.5\n[[boundary]]\non = \"hole\"\n"
                             "traction = [0, 0.1]\n[[probe]]\nname = \"corner\"\nat = [4, 4]\n";
  const auto without_arc = replaced(common, "[[boundary]]\non = \"hole\"\nnormal_displacement = \"0.01*x\"\n", "");
  const std::vector<std::string> loads{"force = [1, 0]", "pressure = \"0.1*y\"", "traction = [0, 1]\n"};
  for (const std::string& basis : {std::string(), std::string("kind = \"p2\""), std::string("order = 2")}) {
    std::string text = with(without_arc, "", basis);
    for (std::size_t k = 0; k < loads.size(); ++k)
      text += fmt::format("[[case]]\nname = \"{}\"\n[[case.boundary]]\non = \"right\"\n{}\n", k, loads[k]);
    const auto all = solved(text);
    ASSERT_EQ(all.more.size(), 2u);
    for (std::size_t k = 0; k < loads.size(); ++k) {
      const auto alone = solved(with(without_arc, "", basis) + "[[boundary]]\non = \"right\"\n" + loads[k] + "\n");
      const Answer<2>& answer = k == 0 ? static_cast<const Answer<2>&>(all) : all.more[k - 1];
      const double close = basis == "kind = \"p2\"" ? 1e-9 : 0.01;  // iterations end at a per cent
      const Vec<2> there = alone.probes[0].second.displacement;
      EXPECT_LT((answer.probes[0].second.displacement - there).norm(), close * there.norm()) << basis << k;
      EXPECT_NEAR(answer.extremes[1].value, alone.extremes[1].value, 3.0 * close * alone.extremes[1].value);
      EXPECT_NEAR(answer.solution.strain_energy, alone.solution.strain_energy, close * alone.solution.strain_energy);
      EXPECT_LT(answer.balance.error, 1e-10);
      EXPECT_EQ(answer.balance.loads.size(), 2u);
      EXPECT_EQ(answer.estimates.has_value(), alone.estimates.has_value());
    }
  }
}

TEST(Results, FieldsOfAnyoneAreWrittenWithoutACase) {
  const Workspace work;
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.3});
  const FineSpace<2> space(mesh, 2);
  Fields<2> fields{space.points(), VoigtPoints<2>::Zero(4, space.num_places()),
                   VoigtPoints<2>::Ones(4, space.num_places())};
  write_fields(work / "own.vtu", space, fields);
  const std::string written = test::content(work / "own.vtu");
  for (const char* name : {"displacement", "strain", "stress", "von_mises", "region"})
    EXPECT_THAT(written, HasSubstr(std::string("Name=\"") + name + "\""));
  fields.stress.resize(4, 3);
  EXPECT_THROW(write_fields(work / "own.vtu", space, fields), InputError);
}

TEST(Results, HaveExtremesOfAllFieldsReactionsLoadsAndTheirBalance) {
  const Workspace work(test::strip_case);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  for (const char* said :
       {"reaction of \"left\": force (-1, ", "load traction on \"right\": force (1, 0), moment (-0.5)",
        "largest displacement 2.0", "largest von Mises stress 1 at", "balance to"})
    EXPECT_THAT(run.output, HasSubstr(said));
  const auto result = json(work / "out/result.json");
  EXPECT_NEAR(result["extremes"]["von_mises"]["value"], 1.0, 1e-3);
  EXPECT_NEAR(result["extremes"]["displacement_x"]["max"]["value"], 2.0, 1e-3);
  EXPECT_EQ(result["extremes"]["displacement_x"]["max"]["at"][0], 2.0);
  EXPECT_NEAR(result["extremes"]["displacement_y"]["min"]["value"], -0.3, 1e-3);
  EXPECT_NEAR(result["extremes"]["strain_zz"]["min"]["value"], -0.3, 1e-3);
  EXPECT_NEAR(result["extremes"]["principal_stress"]["max"]["value"], 1.0, 1e-3);
  EXPECT_NEAR(result["extremes"]["principal_stress"]["min"]["value"], 0.0, 1e-3);
  EXPECT_NEAR(result["reactions"]["left"]["force"][0], -1.0, 1e-9);
  EXPECT_NEAR(result["reactions"]["left"]["moment"], 0.5, 1e-3);
  EXPECT_EQ(result["loads"][0]["on"], "right");
  EXPECT_EQ(result["loads"][0]["kind"], "traction");
  EXPECT_NEAR(result["balance"]["loads"]["force"][0], 1.0, 1e-12);
  EXPECT_LT(result["balance"]["error"], 1e-10);
}

/// What is wrong with it, if anything.
std::string complaint(const std::string& text) {
  const Workspace work(text);
  try {
    std::visit([](const auto& analysis) { prepare(analysis); }, read_case(work / "case.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// A list of parts is one part.
TEST(Parts, InAListAreSupportedAndLoadedTogether) {
  const std::string strip = R"([geometry]
shape = "rectangle"
parameters = { width = 4, height = 1 }
mesh_size = 0.25
[analysis]
plane = "stress"
[material]
E = 1
nu = 0
[basis]
kind = "p2"
[[boundary]]
on = ["left", "right"]
displacement = [0, 0]
[[boundary]]
on = ["top", { plane = { point = [0, 0], normal = [0, 1] } }]
force = [0.4, 0]
[[reaction]]
name = "walls"
on = ["left", "right"]
[[probe]]
name = "middle"
at = [2, 0.5]
)";
  const auto together = solved(strip);
  // Two sides of length 4 with 0.05 each: u'' = -0.1, u = 0.2 in the middle.
  EXPECT_NEAR(together.probes[0].second.displacement.x(), 0.2, 0.02);
  EXPECT_NEAR(together.balance.reactions.at("left + right").force.x(), -0.4, 1e-9);
  const auto apart = solved(replaced(
      replaced(replaced(strip, "on = [\"left\", \"right\"]\ndisplacement = [0, 0]",
                        "on = \"left\"\ndisplacement = [0, 0]\n[[boundary]]\non = \"right\"\ndisplacement = [0, 0]"),
               "[[reaction]]\nname = \"walls\"\non = [\"left\", \"right\"]\n", ""),
      "on = [\"top\", { plane = { point = [0, 0], normal = [0, 1] } }]\nforce = [0.4, 0]",
      "on = \"top\"\ntraction = [0.05, 0]\n[[boundary]]\non = \"bottom\"\ntraction = [0.05, 0]"));
  EXPECT_NEAR(apart.probes[0].second.displacement.x(), together.probes[0].second.displacement.x(), 1e-12);
  EXPECT_THAT(complaint(replaced(strip, "force = [0.4", "traction = [0.4") +
                        "[[boundary]]\non = \"right\"\ntraction = [1, 0]\n"),
              HasSubstr("traction on \"right\" contradicts the displacement component x prescribed at"));
  EXPECT_THAT(complaint(replaced(strip, "[\"top\", {", "[\"top\", \"left\", {")),
              HasSubstr("contradicts the displacement"));
  EXPECT_THAT(complaint(strip + "[[boundary]]\non = [\"right\", \"top\"]\ndisplacement = [0, 0]\n"),
              HasSubstr("displacement component x on \"right\" is already prescribed at"));
  EXPECT_THAT(complaint(replaced(strip, "[\"top\", {", "[\"top\", \"lid\", {")), HasSubstr("\"lid\""));
  EXPECT_THAT(complaint(replaced(strip, "[\"top\", {", "[\"top\", \"top\", {")), HasSubstr("on names \"top\" twice"));
  EXPECT_THAT(complaint(replaced(strip, "[\"top\", {", "[3, {")), HasSubstr("on has something else in its list"));
  EXPECT_THAT(complaint(replaced(strip, "on = [\"left\", \"right\"]\ndisp", "on = []\ndisp")),
              HasSubstr("on is an empty list"));
}

TEST(Loads, ThatMakeNoSenseAreRefusedWithTheirLine) {
  EXPECT_THAT(complaint(replaced(plate, "force = [1, 0.3]\n", "at = [1, 1]\n")),
              HasSubstr("at is where a force acts, and there is no force"));
  EXPECT_THAT(complaint(replaced(plate, "moment = 2", "moment = [0, 0, 2]")), HasSubstr("moment"));
  EXPECT_THAT(complaint(replaced(cook, "traction = [0, 0.1]", "force = [0, 0, 0.1]")), HasSubstr("expected"));
  EXPECT_THAT(complaint(cook + "[[boundary]]\non = \"bottom\"\nforce = [0, 1]\n"),
              HasSubstr("force on \"bottom\" contradicts the displacement component y prescribed at"));
  EXPECT_THAT(complaint(cook + "[[boundary]]\non = \"left\"\nstiffness = 1\n"), HasSubstr("is already prescribed at"));
  EXPECT_THAT(complaint(replaced(plate, "normal_stiffness = 0.5", "normal_stiffness = -0.5")),
              HasSubstr("normal_stiffness is -0.5, expected a number >= 0"));
  EXPECT_THAT(complaint(replaced(cylinder, "force = [0, 2]", "force = [1, 2]")),
              HasSubstr("radial forces have no resultant"));
  EXPECT_THAT(complaint(replaced(cylinder, "speed = 0.3", "speed = 0.3, axis = [0, 1, 0]")), HasSubstr("its own axis"));
  EXPECT_THAT(complaint(replaced(cylinder, "density = 1\n", "")),
              HasSubstr("analysis.rotation needs the density of the material"));
  EXPECT_THAT(complaint(replaced(cylinder, "density = 1\n", "density = -1\n")), HasSubstr("density is -1, expected"));
  EXPECT_THAT(complaint(replaced(box, "axis = [1, 1, 0]", "axis = [0, 0, 0]")), HasSubstr("axis is zero"));
  EXPECT_THAT(complaint(replaced(box, "force = [0.1", "displacement = [0, 0, 0]\nforce = [0.1")),
              HasSubstr("displacement and force"));
  const std::string one = "[[case]]\nname = \"one\"\n";
  EXPECT_THAT(complaint(cook + one + "[[case.boundary]]\non = \"top\"\ndisplacement = [0, 0]\n"),
              HasSubstr("what holds the body is the same for all load cases"));
  EXPECT_THAT(complaint(cook + one + "[[case.boundary]]\non = \"left\"\ntraction = [1, 0]\n"),
              HasSubstr("contradicts the displacement component x"));
  EXPECT_THAT(complaint(cook + one + one), HasSubstr("there already is a case named \"one\""));
  EXPECT_THAT(complaint(cook + one + "[[case.boundary]]\non = \"tip\"\ntraction = [1, 0]\n"), HasSubstr("\"tip\""));
  EXPECT_THAT(complaint(cook + one + "[accuracy]\nenergy = 0.1\n"), HasSubstr("several load cases"));
}

}  // namespace
}  // namespace efree
