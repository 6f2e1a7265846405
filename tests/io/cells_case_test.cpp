// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files of images in space that are solved on cells.
#include "efree/tests/io/workspace.hpp"

#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

namespace efree {
namespace {

using test::json, test::replaced, test::Workspace;
namespace fs = std::filesystem;
using ::testing::AllOf, ::testing::HasSubstr;

constexpr int n = 24;

/// A cube with a ball of another label (or void) in a corner, pulled along z between planes that slide.
const std::string ball_case = R"([geometry]
file = "ball.raw"
[geometry.image]
raw = { size = [24, 24, 24], type = "uint8" }
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
)";

struct Ball : Workspace {
  explicit Ball(const std::string& text, unsigned char inside = 0) : Workspace(text) {
    std::ofstream image(*this / "ball.raw", std::ios::binary);
    for (int p = 0; p < n * n * n; ++p) {
      const double x = p % n + 0.5, y = p / n % n + 0.5, z = p / n / n + 0.5;
      image.put(static_cast<char>(std::sqrt(x * x + y * y + z * z) < 8.0 ? inside : 1));
    }
  }
  Case<3> read() const { return std::get<Case<3>>(read_case(*this / "case.toml")); }
};

ImageResult answer_on_cells(const Case<3>& analysis) {
  auto result = analyse_image(analysis);
  if (!result) throw std::logic_error("not on cells");
  return std::move(*result);
}

double energy_of_quadratic_elements(Case<3> analysis) {
  analysis.cells = OnCells::never;
  analysis.common.approximation.kind = BasisKind::p2;
  return analyse(analysis).solution.strain_energy;
}

/// What iterations leave goes to the sides that hold its direction.
TEST(CellsCase, ReactionsBalanceLoadsThatAreSpreadOverWhatTheImageHasOfASide) {
  const std::string loaded =
      replaced(ball_case, "displacement = [\"free\", \"free\", 0.24]", "force = [0, 0, 50]\nat = [10, 11, 24]") +
      "[[boundary]]\non = \"right\"\ndisplacement = [0.1, \"free\", \"free\"]\n[[boundary]]\non = "
      "\"back\"\ntraction = [0, \"0.01*z\", 0]\n";
  const auto result = answer_on_cells(Ball(loaded).read());
  ASSERT_EQ(result.balance.loads.size(), 2u);
  EXPECT_LT((result.balance.loads[1].of.force - Vec<3>(0, 0, 50)).norm(), 1e-9);
  EXPECT_LT((result.balance.loads[1].of.moment - Vec<3>(550, -500, 0)).norm(), 1e-7) << "(10, 11, 24) x (0, 0, 50)";
  EXPECT_LT(result.balance.error, 1e-10);
  EXPECT_EQ(result.balance.reactions.size(), 4u);
  EXPECT_NEAR(result.balance.reactions.at("bottom").force.z(), -50.0, 1e-9);
  EXPECT_GT(result.balance.reactions.at("right").force.x(), 10.0);
}

TEST(CellsCase, AreWhatImagesInSpaceAreSolvedOnAndSayTheirError) {
  const Ball work(ball_case);
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(work / "out/result.json");
  EXPECT_FALSE(fs::exists(work / "out/nodes.vtu"));
  EXPECT_TRUE(fs::exists(work / "out/fields.vti"));
  ASSERT_GE(result["grids"].size(), 2U);
  EXPECT_GT(result["grids"][1]["strain_energy"], result["grids"][0]["strain_energy"]);
  EXPECT_LT(result["strain_energy_extrapolated"], result["strain_energy"]);
  EXPECT_LT(result["estimates"]["energy"]["total"], 0.1);
  EXPECT_GT(result["estimates"]["energy"]["image"], 0.0);
}

TEST(CellsCase, FieldsAreOnTheGridWithVoidHidden) {
  const Ball work(ball_case);
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const vtkNew<vtkXMLImageDataReader> reader;
  reader->SetFileName((work / "out/fields.vti").c_str());
  reader->Update();
  vtkImageData* grid = reader->GetOutput();
  int dimensions[3];
  grid->GetDimensions(dimensions);
  vtkDataArray *u = grid->GetPointData()->GetArray("displacement"), *region = grid->GetCellData()->GetArray("region"),
               *solid = grid->GetCellData()->GetArray("solid"), *stress = grid->GetCellData()->GetArray("stress"),
               *hidden = grid->GetCellData()->GetArray("vtkGhostType");
  ASSERT_TRUE(u && region && solid && stress && hidden);
  EXPECT_STREQ(stress->GetComponentName(4), "xz");
  double material = 0.0, mean = 0.0;
  for (vtkIdType c = 0; c < grid->GetNumberOfCells(); ++c) {
    material += solid->GetTuple1(c);
    mean += solid->GetTuple1(c) * stress->GetComponent(c, 2);
    EXPECT_EQ(hidden->GetTuple1(c) != 0.0, solid->GetTuple1(c) == 0.0);
    EXPECT_EQ(region->GetTuple1(c), solid->GetTuple1(c) > 0.0 ? 0.0 : -1.0);
  }
  const double cells = static_cast<double>(grid->GetNumberOfCells()), ball = 4.0 / 3.0 * M_PI * 512.0 / 8.0;
  EXPECT_NEAR(material / cells, 1.0 - ball / (n * n * n), 2e-3);
  for (vtkIdType p = 0; p < grid->GetNumberOfPoints(); ++p)
    if (grid->GetPoint(p)[2] == n) {
      EXPECT_NEAR(u->GetComponent(p, 2), 0.24, 1e-6);
    }
  // The mean stress in the box times its length is twice the energy over the strain.
  const double energy = json(work / "out/result.json")["strain_energy"];
  EXPECT_NEAR(mean / cells * 0.01 * n * n * n, 2.0 * energy, 0.01 * energy);
}

TEST(CellsCase, AMeshCarriesTheSameFieldsWhenItIsAskedFor) {
  const std::string two_cases = ball_case +
                                "[[probe]]\nname = \"corner\"\nat = [24, 24, 24]\n[[case]]\nname = "
                                "\"plain\"\n[[case]]\nname = \"pressed\"\n[[case.boundary]]\non = "
                                "\"right\"\npressure = 0.01\n";
  const Ball grid(two_cases), mesh(two_cases + "[output]\nmesh = true\n");
  ASSERT_EQ(grid.efree({"solve", "case.toml", "--out", "out"}).status, 0);
  ASSERT_EQ(mesh.efree({"solve", "case.toml", "--out", "out"}).status, 0);
  EXPECT_FALSE(fs::exists(grid / "out/fields.vtu"));
  const auto one = json(grid / "out/result.json"), other = json(mesh / "out/result.json");
  for (const char* same : {"strain_energy", "reactions", "probes", "extremes", "cases"})
    EXPECT_EQ(one[same], other[same]) << same;
  const vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName((mesh / "out/fields.vtu").c_str());
  reader->Update();
  vtkPointData* fields = reader->GetOutput()->GetPointData();
  vtkDataArray *u = fields->GetArray("displacement"), *pressed = fields->GetArray("pressed: displacement"),
               *stress = fields->GetArray("von_mises");
  ASSERT_TRUE(u && pressed && stress);
  double most = 0.0, largest = 0.0, across = 0.0;
  for (vtkIdType p = 0; p < u->GetNumberOfTuples(); ++p) {
    const double* x = reader->GetOutput()->GetPoint(p);
    if (x[2] == n) {
      EXPECT_NEAR(u->GetComponent(p, 2), 0.24, 1e-6);
    }
    most = std::max(most, stress->GetTuple1(p));
    largest = std::max(largest, Vec<3>(u->GetTuple3(p)).norm());
    across = std::max(across, std::abs(pressed->GetComponent(p, 0) - u->GetComponent(p, 0)));
  }
  EXPECT_NEAR(most, one["extremes"]["von_mises"]["value"], 0.15 * most);
  EXPECT_NEAR(largest, one["extremes"]["displacement"]["value"], 0.01 * largest);
  EXPECT_NEAR(across, 0.24, 0.05) << "a stress of 0.01 over a length of 24, the ball a little";
  const auto& region = one["by_region"]["1"];
  EXPECT_NEAR(region["volume"], n * n * n - 4.0 / 3.0 * M_PI * 512.0 / 8.0, 30.0);
  EXPECT_LT(region["von_mises_quantiles"]["50"], region["von_mises_quantiles"]["99"]);
  EXPECT_LT(region["von_mises_quantiles"]["99"], region["von_mises"]);
}

TEST(CellsCase, SelectionsThatCoverASideAreThatSide) {
  const Ball named(ball_case);
  ASSERT_EQ(named.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const double energy = json(named / "out/result.json")["strain_energy"];
  for (const char* selection : {"{ plane = { point = [1, 2, 24], normal = [0, 0, -2] } }",
                                "{ box = [[-1, -1, 23.9], [25, 25, 25]] }", "[\"top\"]"}) {
    const Ball work(replaced(ball_case, "on = \"top\"", std::string("on = ") + selection));
    const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
    ASSERT_EQ(run.status, 0) << run.output;
    EXPECT_TRUE(fs::exists(work / "out/fields.vti")) << selection;
    EXPECT_EQ(json(work / "out/result.json")["strain_energy"], energy) << selection;
  }
}

/// What holds the top goes through every slice below it.
TEST(CellsCase, SlicesBearTheForceThatThePlaneAboveThemIsPulledWith) {
  const Ball work(replaced(ball_case, "file = \"ball.raw\"", "file = \"ball.raw\"\nmesh_size = 0.5") +
                  "[[case]]\nname = \"plain\"\n[[case]]\nname = \"pressed\"\n[[case.boundary]]\non = "
                  "\"right\"\npressure = 0.01\n");
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--no-picture"}).status, 0);
  const double pull = json(work / "out/result.json")["reactions"]["top"]["force"][2];
  std::ifstream table(work / "out/slices.csv");
  std::string line;
  std::getline(table, line);
  EXPECT_EQ(
      line,
      "case,axis,at,solid,von_mises,largest_von_mises,stress_xx,stress_yy,stress_zz,stress_yz,stress_xz,stress_xy");
  std::map<std::string, int> slices;
  double material = 0.0;
  while (std::getline(table, line)) {
    std::stringstream cells(line);
    std::string name, axis, cell;
    std::getline(cells, name, ',');
    std::getline(cells, axis, ',');
    std::vector<double> value;
    while (std::getline(cells, cell, ',')) value.push_back(std::stod(cell));
    ASSERT_EQ(value.size(), 10U);
    ++slices[name + axis];
    if (name != "plain" || axis != "z") continue;
    const double area = value[1] * n * n;
    material += area * 0.5;
    EXPECT_NEAR(value[6] * area, pull, 0.01 * pull) << "at " << value[0];
    EXPECT_NEAR(value[1], value[0] < 8.0 ? 1.0 - M_PI / 4.0 * (64.0 - value[0] * value[0]) / (n * n) : 1.0, 4e-3);
    EXPECT_GE(value[3], value[2]);
  }
  EXPECT_EQ(slices.size(), 6U);
  for (const auto& [of, count] : slices) EXPECT_EQ(count, 48) << of;
  EXPECT_NEAR(material, n * n * n - 4.0 / 3.0 * M_PI * 512.0 / 8.0, 10.0);
}

TEST(CellsCase, FilesAreBitwiseTheSameOnAnyNumberOfThreads) {
  const Ball work(ball_case);
  for (const std::string threads : {"1", "2"})
    ASSERT_EQ(work.efree({"solve", "case.toml", "--out", threads, "--threads", threads}).status, 0);
  for (const char* file : {"fields.vti", "fields.png", "slices.csv"})
    EXPECT_TRUE(test::content(work / "1" / file) == test::content(work / "2" / file)) << file;
}

TEST(CellsCase, EnergyIsThatOfQuadraticElementsWithinTheErrorsSaid) {
  const Ball work(ball_case);
  const ImageResult cells = answer_on_cells(work.read());
  const double energy = energy_of_quadratic_elements(work.read());
  // The boundaries of the two differ: half a voxel would change the energy by more than a per cent.
  EXPECT_NEAR(cells.cells->extrapolated_energy, energy, 0.005 * energy);
  EXPECT_NEAR(cells.solution.strain_energy, energy, std::pow(cells.estimates->total(), 2) * energy + 0.005 * energy);
}

TEST(CellsCase, InclusionsHaveTheirMaterialsByName) {
  const std::string two = replaced(ball_case, "[material]\nE = 1\nnu = 0.3\n",
                                   "[[material]]\nregion = \"2\"\nE = 10\nnu = 0.2\n[[material]]\nregion = \"1\"\nE = "
                                   "1\nnu = 0.3\n");
  const Ball work(two, 2);
  const ImageResult cells = answer_on_cells(work.read());
  const double energy = energy_of_quadratic_elements(work.read());
  EXPECT_NEAR(cells.cells->extrapolated_energy, energy, 0.01 * energy);
}

const std::string orthotropic = R"([material]
model = "orthotropic"
E = [10, 3, 1]
nu = [0.3, 0.25, 0.35]
G = [0.7, 1.1, 2]
axes = [[1, 1, 0], [-1, 1, 1]]
)";

TEST(CellsCase, AnisotropicMaterialsAndInclusionsHaveTheEnergyOfQuadraticElements) {
  for (const unsigned char inside : {0, 2}) {
    std::string text = replaced(ball_case, "[material]\nE = 1\nnu = 0.3\n", orthotropic);
    if (inside == 2)
      text =
          replaced(text, "[material]", "[[material]]\nregion = \"2\"\nE = 20\nnu = 0.2\n[[material]]\nregion = \"1\"");
    const Ball work(text, inside);
    const ImageResult cells = answer_on_cells(work.read());
    const double energy = energy_of_quadratic_elements(work.read());
    EXPECT_NEAR(cells.cells->extrapolated_energy, energy, 0.005 * energy);
    EXPECT_NEAR(cells.solution.strain_energy, energy, std::pow(cells.estimates->total(), 2) * energy + 0.005 * energy);
    EXPECT_LT(cells.balance.error, 1e-10);
  }
}

TEST(CellsCase, FinerGridsFollowUntilAnAccuracyIsReached) {
  const Ball work(ball_case + "[accuracy]\nenergy = 0.02\n");
  const ImageResult result = answer_on_cells(work.read());
  EXPECT_GE(result.attempts.size(), 2U);
  EXPECT_LE(result.estimates->total(), 0.02);
  EXPECT_TRUE(result.warnings.empty());
}

const std::string held_below = replaced(ball_case, R"([[boundary]]
on = "top"
displacement = ["free", "free", 0.24]
)",
                                        "");

/// The answer on cells and the energy of quadratic elements on a mesh of the same case.
void expect_energy_of_elements(const std::string& text, double tolerance) {
  const Ball work(text);
  const ImageResult cells = answer_on_cells(work.read());
  const double energy = energy_of_quadratic_elements(work.read()),
               error = std::pow(cells.estimates->total(), 2) * energy + tolerance * energy;
  EXPECT_NEAR(cells.cells->extrapolated_energy, energy, tolerance * energy);
  EXPECT_NEAR(cells.solution.strain_energy, energy, error);
  EXPECT_LT(cells.balance.error, 1e-10);
}

TEST(CellsCase, AnisotropicMaterialsMayDifferByAFactorFromPlaceToPlace) {
  expect_energy_of_elements(
      replaced(ball_case, "[material]\nE = 1\nnu = 0.3\n", orthotropic + "factor = \"1 + 0.1 * x + 0.002 * z^2\"\n"),
      0.005);
}

/// On faces of voxels, whose ball has 3 % more of a section than the mesh's: twice that in energy.
TEST(CellsCase, PressureInPoresDoesTheWorkThatItDoesOnAMesh) {
  expect_energy_of_elements(held_below + "[[boundary]]\non = \"pores\"\npressure = 0.01\n", 0.08);
}

TEST(CellsCase, PartsOfASideByBoxesAreHeldAndLoadedAsOnAMesh) {
  expect_energy_of_elements(held_below + R"([[boundary]]
on = { box = [[10, 10, 24], [20, 20, 24]] }
force = [0, 0, 2]
)",
                            0.02);
}

TEST(CellsCase, SpringsUnderAPartOfASideGiveWayAsOnAMesh) {
  expect_energy_of_elements(replaced(held_below, "displacement = [\"free\", \"free\", 0]", "normal_stiffness = 0.05") +
                                "[[boundary]]\non = \"top\"\nforce = [0, 0, 3]\nat = [12, 12, 24]\n",
                            0.02);
}

TEST(CellsCase, PartsBalanceInAllLoadCasesAndAreInThePicture) {
  const Ball work(held_below + R"([[reaction]]
name = "feet"
on = "bottom"
[[case]]
name = "gas"
[[case.boundary]]
on = { nearest = [4, 4, 4] }
pressure = 0.01
[[case]]
name = "grip"
[[case.boundary]]
on = [{ box = [[24, 6, 6], [24, 18, 18]] }, "top"]
traction = [0.02, 0, 0.01]
)");
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(work / "out/result.json");
  for (const char* name : {"gas", "grip"}) EXPECT_LT(result["cases"][name]["balance"]["error"], 1e-10) << name;
  EXPECT_NEAR(result["boundaries"]["nearest 1"]["area"], 0.5 * M_PI * 64.0, 0.03 * 0.5 * M_PI * 64.0);
  EXPECT_EQ(result["boundaries"]["box 1 + top"]["facets"], 24 * 24 + 12 * 12);
  EXPECT_NEAR(result["cases"]["grip"]["reactions"]["bottom"]["force"][2], -0.01 * (24 * 24 + 12 * 12), 1e-9);
  EXPECT_NEAR(result["cases"]["gas"]["reactions"]["bottom"]["force"][2], -0.01 * 52.0, 1e-9)
      << "the pressure on the faces of voxels that look up";
  EXPECT_TRUE(fs::exists(work / "out/fields.png"));
}

TEST(CellsCase, CellsLargerThanTheImageAreRefused) {
  const Ball work(replaced(ball_case, "file = \"ball.raw\"", "file = \"ball.raw\"\nmesh_size = 1e6"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("geometry.mesh_size = 1e+06: cells would be larger than the image, which is 24"));
}

TEST(CellsCase, ABodyThatNothingMovesIsWarnedOf) {
  const Ball work(replaced(ball_case, "\"free\", 0.24]", "\"free\", 0]"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("warning: nothing moves or loads the body"));
}

/// A modulus that is nowhere near incompressible where the first voxel is.
TEST(CellsCase, MaterialsAreLookedAtAllOverTheImage) {
  const Ball work(replaced(ball_case, "nu = 0.3", "nu = \"x > 20 ? 0.49995 : 0.3\""));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_THAT(run.output, HasSubstr("nearly incompressible"));
}

TEST(CellsCase, WarningsNameTheirLoadCase) {
  const Ball work(replaced(ball_case, "file = \"ball.raw\"", "file = \"ball.raw\"\nmesh_size = 8") +
                  "[[case]]\nname = \"plain\"\n[[case.boundary]]\non = { box = [[24, 8, 8], [24, 12, 12]] }\nforce = "
                  "[9, 0, 0]\n");
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  EXPECT_THAT(run.output, HasSubstr("case \"plain\": in the energy norm the grid leaves an error of about"));
}

TEST(CellsCase, WhatTakesAMeshSaysSo) {
  const Ball work(replaced(ball_case, "nu = 0.3", "nu = 0.4995"));
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("not on cells, as the material of the region \"1\" is nearly incompressible"));
  EXPECT_TRUE(fs::exists(work / "out/fields.vtu"));
}

struct Wrong {
  const char* add;
  const char* says;
};
class WrongCells : public ::testing::TestWithParam<Wrong> {};
TEST_P(WrongCells, AreRefusedWithTheReason) {
  const Ball work(ball_case + GetParam().add);
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, AllOf(HasSubstr("case.toml"), HasSubstr(GetParam().says)));
}
INSTANTIATE_TEST_SUITE_P(
    All, WrongCells,
    ::testing::Values(Wrong{"[basis]\nkind = \"cells\"\n[cloud]\nspacing = 4\n", "[cloud] means nothing on cells"},
                      Wrong{"[basis]\nkind = \"cells\"\norder = 2\n", "basis.order means nothing on cells"},
                      Wrong{"[[boundary]]\non = { box = [[1, 1, 1], [3, 3, 3]] }\npressure = 1\n",
                            "the selection \"box 1\" is empty"},
                      Wrong{"[[boundary]]\non = { box = [[0, 0, 0], [30, 30, 0]] }\ndisplacement = [\"free\", "
                            "\"free\", 1]\n",
                            "displacements prescribed on \"bottom\" and \"box 1\" contradict each other"},
                      Wrong{"[[probe]]\nname = \"void\"\nat = [1, 1, 1]\n",
                            "the probe \"void\" at (1, 1, 1) lies outside"},
                      Wrong{"[[probe]]\nname = \"void\"\nat = [3.5, 3.5, 3.5]\n", "lies outside the body"},
                      Wrong{"[[boundary]]\non = \"topp\"\npressure = 1\n", "topp"},
                      Wrong{"[basis]\nkind = \"cells\"\n[exact]\ndisplacement = [0, 0, 0]\n",
                            "basis.kind = \"cells\" does not do here: there is an exact solution"},
                      Wrong{"[basis]\nkind = \"cell\"\n", "kind is \"cell\""}));

TEST(CellsCase, BodiesThatMayMoveAndLabelsWithoutMaterialAreRefused) {
  const Ball loose(replaced(ball_case, "[[boundary]]\non = \"left\"\ndisplacement = [0, \"free\", \"free\"]\n", ""));
  auto run = loose.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("free to move"));
  const Ball two(replaced(ball_case, "[material]", "[[material]]\nregion = \"1\""), 2);
  run = two.efree({"solve", "case.toml", "--out", "out"});
  EXPECT_EQ(run.status, 2);
  EXPECT_THAT(run.output, HasSubstr("no [[material]] for the region \"2\""));
}

}  // namespace
}  // namespace efree
