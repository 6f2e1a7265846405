// SPDX-License-Identifier: GPL-3.0-or-later
// Cases on every kind of geometry: shapes, label images, surfaces; in the plane and in space.
#include "../geometry/surfaces.hpp"
#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"
#include "workspace.hpp"

#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <regex>

namespace efree::test {
namespace {

const std::vector<std::string> solve_here{"solve", "case.toml", "--out", "out", "--quiet", "--no-picture"};

/// Message of the InputError that reading or solving the case in the folder ends in, without the folder's name.
template <int Dim> std::string complaint(const Workspace& work, bool solve = false) {
  try {
    const auto analysis = std::get<Case<Dim>>(read_case(work / "case.toml"));
    const auto mesh = prepare(analysis);
    if (solve) analyse(mesh, analysis);
  } catch (const InputError& error) {
    return std::regex_replace(error.what(), std::regex((work / "").string()), "");
  }
  return "no error";
}
template <int Dim> std::string complaint(const std::string& text, bool solve = false) {
  return complaint<Dim>(Workspace(text), solve);
}
void expect_matches(const std::string& message, const std::string& expected) {
  EXPECT_TRUE(std::regex_search(message, std::regex(expected))) << message << "\nexpected: " << expected;
}

template <int Dim> Result<Dim> solved(const Workspace& work) {
  return analyse(std::get<Case<Dim>>(read_case(work / "case.toml")));
}
template <int Dim> PreparedMesh<Dim> meshed(const Workspace& work) {
  return prepare(std::get<Case<Dim>>(read_case(work / "case.toml")));
}

// --- a bar in space, no names needed ---------------------------------------------------------------------------------

/// [0, 2] x [0, 1] x [0, 1] under a stress of 5 along x: E = 5, so that u = (x, -0.3 y, -0.3 z).
const std::string bar_case = R"(title = "bar"
[geometry]
shape = "box"
parameters = { width = 2, depth = 1, height = 1 }
mesh_size = 0.4
[cloud]
spacing = 0.8
[basis]
kind = "mls"
[material]
E = 5
nu = 0.3
[[boundary]]
on = { plane = { point = [0, 0, 0], normal = [-2, 0, 0] } }
displacement = [0, "free", "free"]
[[boundary]]
on = { normal = [0, -1, 0], angle = 10 }
displacement = ["free", 0, "free"]
[[boundary]]
on = { nearest = [1, 0.5, -3] }
normal_displacement = 0
[[boundary]]
on = { box = [[2, 1, 1], [2, 0, 0]] }
traction = [5, 0, 0]
[[boundary]]
on = "right"
traction = [0, 0, 0]
[exact]
displacement = ["x", "-0.3*y", "-0.3*z"]
stress = [5, 0, 0, 0, 0, 0]
[[probe]]
name = "end"
at = [2.0, 0.5, 0.5]
)";

TEST(SolidCase, TensionOfABarComesOutExactly) {
  for (const char* kind : {"mls", "p1", "p2"}) {
    const Workspace work(replaced(bar_case, "kind = \"mls\"", std::string("kind = \"") + kind + "\""));
    const auto run = work.efree(solve_here);
    ASSERT_EQ(run.status, 0) << run.output;
    EXPECT_EQ(run.output, "");
    const auto result = json(work / "out/result.json");
    EXPECT_EQ(result["dimension"], 3);
    for (const char* error : {"l2_displacement", "energy_norm", "energy_norm_recovered"})
      EXPECT_LT(result["errors"][error], 1e-9) << kind << ' ' << error;
    EXPECT_NEAR(result["strain_energy"], 5.0, 1e-8);
    const auto& probe = result["probes"]["end"];
    ASSERT_EQ(probe["displacement"].size(), 3u);
    ASSERT_EQ(probe["stress"].size(), 6u);
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(probe["stress"][i], i == 0 ? 5.0 : 0.0, 1e-8) << kind << ' ' << i;
      EXPECT_NEAR(probe["strain"][i], i == 0 ? 1.0 : i < 3 ? -0.3 : 0.0, 1e-8) << kind << ' ' << i;
    }
    const auto& parts = result["boundaries"];
    ASSERT_EQ(parts.size(), 5u);
    for (const auto& [name, area] : std::map<std::string, double>{
             {"plane 1", 1.0}, {"normal 1", 2.0}, {"nearest 1", 2.0}, {"box 1", 1.0}, {"right", 1.0}}) {
      EXPECT_NEAR(parts[name]["area"], area, 1e-12) << name;
      EXPECT_GT(parts[name]["facets"], 1) << name;
    }
  }
}

TEST(SolidCase, FieldsShowWhereTheBodyIsHeldAndLoaded) {
  for (const auto& [kind, cell_type] : {std::pair("mls", VTK_TETRA), std::pair("p2", VTK_QUADRATIC_TETRA)}) {
    const Workspace work(replaced(replaced(bar_case, "kind = \"mls\"", std::string("kind = \"") + kind + "\""),
                                  "[[boundary]]\non = \"right\"\ntraction = [0, 0, 0]\n", ""));
    ASSERT_EQ(work.efree(solve_here).status, 0);
    vtkNew<vtkXMLUnstructuredGridReader> reader;
    const std::string file = (work / "out/fields.vtu").string();
    reader->SetFileName(file.c_str());
    reader->Update();
    vtkUnstructuredGrid* grid = reader->GetOutput();
    ASSERT_GT(grid->GetNumberOfCells(), 0);
    EXPECT_EQ(grid->GetCellType(0), cell_type);
    vtkDataArray *u = grid->GetPointData()->GetArray("displacement"),
                 *stress = grid->GetPointData()->GetArray("stress"),
                 *mises = grid->GetPointData()->GetArray("von_mises"),
                 *restrained = grid->GetPointData()->GetArray("restrained"),
                 *loaded = grid->GetPointData()->GetArray("loaded"), *region = grid->GetCellData()->GetArray("region");
    ASSERT_TRUE(u && stress && mises && restrained && loaded && region);
    ASSERT_EQ(stress->GetNumberOfComponents(), 6);
    EXPECT_STREQ(stress->GetComponentName(3), "yz");
    for (vtkIdType p = 0; p < grid->GetNumberOfPoints(); ++p) {
      const double* x = grid->GetPoint(p);
      ASSERT_NEAR(u->GetComponent(p, 0), x[0], 1e-8);
      ASSERT_NEAR(u->GetComponent(p, 2), -0.3 * grid->GetPoint(p)[2], 1e-8);
      ASSERT_NEAR(mises->GetComponent(p, 0), 5.0, 1e-7);
      x = grid->GetPoint(p);
      ASSERT_EQ(restrained->GetComponent(p, 0), x[0] < 1e-9 || x[1] < 1e-9 || x[2] < 1e-9);
      ASSERT_EQ(loaded->GetComponent(p, 0), x[0] > 2.0 - 1e-9);
    }
    EXPECT_EQ(region->GetRange()[1], 0.0);
    // Points 4 to 9 of a quadratic tetrahedron: the middles of the edges of the base, then of those up to the apex.
    constexpr int edges[6][2]{{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
    for (vtkIdType c = 0; cell_type == VTK_QUADRATIC_TETRA && c < grid->GetNumberOfCells(); ++c) {
      const vtkIdType* points = nullptr;
      vtkIdType size = 0;
      grid->GetCellPoints(c, size, points);
      ASSERT_EQ(size, 10);
      auto* at = grid->GetPoints()->GetData();
      for (int e = 0; e < 6; ++e)
        for (int k = 0; k < 3; ++k)
          ASSERT_NEAR(at->GetComponent(points[4 + e], k),
                      0.5 * (at->GetComponent(points[edges[e][0]], k) + at->GetComponent(points[edges[e][1]], k)),
                      1e-12);
    }
  }
}

TEST(SolidCase, PlaneHasNoMeaning) {
  expect_matches(complaint<3>(replaced(bar_case, "[material]", "[analysis]\nplane = \"strain\"\n[material]")),
                 R"(^case.toml:11: plane means nothing here: the geometry is three-dimensional)");
  expect_matches(complaint<3>(replaced(bar_case, "traction = [5, 0, 0]", "traction = [5, 0]")),
                 R"(^case.toml:24: traction is an array of 2, expected an array of 3)");
}

// --- a body of revolution --------------------------------------------------------------------------------------------

/// Solid cylinder of radius 1 and height 2 pulled along its axis by a stress of 5: E = 5, so that u = (-0.3 r, z).
const std::string cylinder_case = R"(title = "cylinder"
[geometry]
shape = "rectangle"
parameters = { width = 1, height = 2 }
mesh_size = 0.1
[cloud]
spacing = 0.3
[analysis]
plane = "axisymmetric"
[material]
E = 5
nu = 0.3
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "top"
traction = [0, 5]
[exact]
displacement = ["-0.3*x", "y"]
stress = [0, 5, 0, 0]
[[probe]]
name = "on the axis"
at = [0, 1]
)";

TEST(AxisymmetricCase, TensionAlongTheAxisComesOutExactly) {
  for (const std::string kind : {"mls", "p1", "p2"}) {
    const Workspace work(replaced(cylinder_case, "[material]", "[basis]\nkind = \"" + kind + "\"\n[material]"));
    const auto run = work.efree(solve_here);
    ASSERT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    EXPECT_LT(result["errors"]["l2_displacement"], 1e-10) << kind;
    EXPECT_LT(result["errors"]["energy_norm"], 1e-10) << kind;
    EXPECT_NEAR(result["strain_energy"], 0.5 * 5.0 * 2.0 * std::acos(-1.0), 1e-9) << kind;
    const auto& probe = result["probes"]["on the axis"];
    ASSERT_EQ(probe["stress"].size(), 4u);
    const double stress[] = {0.0, 5.0, 0.0, 0.0}, strain[] = {-0.3, 1.0, -0.3, 0.0};
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(probe["stress"][i], stress[i], 1e-9) << kind << ' ' << i;
      EXPECT_NEAR(probe["strain"][i], strain[i], 1e-9) << kind << ' ' << i;
    }
    const vtkNew<vtkXMLUnstructuredGridReader> reader;
    reader->SetFileName((work / "out/fields.vtu").c_str());
    reader->Update();
    const auto data = reader->GetOutput()->GetPointData();
    vtkDataArray* array = data->GetArray("stress");
    ASSERT_EQ(array->GetNumberOfComponents(), 4);
    const char* names[] = {"rr", "zz", "tt", "rz"};
    for (int i = 0; i < 4; ++i) EXPECT_STREQ(array->GetComponentName(i), names[i]);
    for (vtkIdType v = 0; v < array->GetNumberOfTuples(); ++v)
      ASSERT_NEAR(data->GetArray("von_mises")->GetTuple1(v), 5.0, 1e-9);
  }
}

TEST(AxisymmetricCase, RefusesWhatMakesNoSense) {
  expect_matches(complaint<2>(replaced(cylinder_case, "stress = [0, 5, 0, 0]", "stress = [0, 5, 0]")),
                 "^case.toml:21: stress is an array of 3, expected an array of 4");
  expect_matches(complaint<2>(replaced(cylinder_case, "{ width", "{ x = -0.5, width"), true), "negative radius");
  expect_matches(complaint<2>(replaced(cylinder_case, "normal_displacement = 0", "displacement = [0, \"free\"]"), true),
                 "translation along the axis");
}

// --- selections ------------------------------------------------------------------------------------------------------

TEST(SelectionInCase, EqualOnesShareAName) {
  const Workspace work(replaced(bar_case, "on = \"right\"", "on = { box = [[2, 0, 0], [2, 1, 1]] }"));
  const auto bar = std::get<Case<3>>(read_case(work / "case.toml"));
  EXPECT_EQ(bar.common.selections.size(), 4u);
  ASSERT_EQ(bar.loads.tractions.size(), 2u);
  EXPECT_EQ(bar.loads.tractions[0].on, "box 1");
  EXPECT_EQ(bar.loads.tractions[1].on, "box 1");
  // What contradicts itself on one part does so whichever way it is selected.
  expect_matches(complaint<3>(replaced(bar_case, "on = { box = [[2, 1, 1], [2, 0, 0]] }",
                                       "on = { plane = { point = [0, 0, 0], normal = [-2, 0, 0] } }")),
                 R"(^case.toml:24: traction on "plane 1" contradicts the displacement component x .* case.toml:15)");
}

TEST(SelectionInCase, DirectionsHaveAnyLength) {
  for (const char* normal : {"[1, 0, 0]", "[3e300, 0, 0]", "[1e-310, 0, 0]"}) {
    const Workspace work(replaced(bar_case, "{ box = [[2, 1, 1], [2, 0, 0]] }",
                                  "{ plane = { point = [2, 0, 0], normal = " + std::string(normal) + " } }"));
    const auto bar = std::get<Case<3>>(read_case(work / "case.toml"));
    bool named = false;
    for (const NamedSelection<3>& selection : bar.common.selections)
      if (const auto* plane = std::get_if<OnPlane<3>>(&selection.how); plane && plane->point[0] == 2.0)
        named = plane->normal == Vec<3>::UnitX();
    EXPECT_TRUE(named) << normal;
  }
}

TEST(SelectionInCase, AnEmptyOneIsAnErrorThatSaysWhereTheBodyIs) {
  expect_matches(complaint<3>(replaced(bar_case, "[[2, 1, 1], [2, 0, 0]]", "[[3, 0, 0], [4, 1, 1]]")),
                 R"(^case.toml:23: the selection "box 1" is empty: .* lie in \(0, 0, 0\) to \(2, 1, 1\))");
  expect_matches(complaint<3>(replaced(bar_case, "point = [0, 0, 0]", "point = [0.1, 0, 0]")),
                 R"(^case.toml:14: the selection "plane 1" is empty)");
}

TEST(SelectionInCase, RefusesWhatMakesNoSense) {
  const auto with = [](const std::string& on) {
    return complaint<3>(replaced(bar_case, "{ box = [[2, 1, 1], [2, 0, 0]] }", on));
  };
  expect_matches(with("{ box = [[2, 1, 1], [2, 0, 0]], normal = [1, 0, 0] }"),
                 R"(^case.toml:23: a selection has exactly one of .*; this one has box and normal)");
  expect_matches(with("{ angle = 20 }"), R"(^case.toml:23: a selection has exactly one of .*; this one has none)");
  expect_matches(with("{ boxes = [] }"), R"(^case.toml:23: unknown key "boxes".*did you mean "box")");
  expect_matches(with("{ box = [[2, 1], [2, 0]] }"), R"(^case.toml:23: box is an array of 2, expected an array of 3)");
  expect_matches(with("{ box = [[2, 1, 1], [2, 0, 0]], angle = 20 }"), R"(^case.toml:23: angle has no meaning)");
  expect_matches(with("{ normal = [0, 0, 0] }"), R"(^case.toml:23: normal is zero, expected a direction)");
  expect_matches(with("{ normal = [1, 0, 0], angle = 0 }"), R"(^case.toml:23: angle is 0, expected a number in \(0)");
  expect_matches(with("{ plane = [1, 0, 0] }"), R"(^case.toml:23: plane is an array of 3, expected a table)");
  expect_matches(with("{ plane = { point = [2, 0, 0] } }"), R"(^case.toml:23: key "normal" is missing)");
  expect_matches(with("2"), R"(^case.toml:23: on is 2, expected a non-empty string)");
}

TEST(SelectionInCase, DisplacementsThatContradictEachOtherWherePartsOverlapAreRefused) {
  const std::string pulled = replaced(bar_case, "[[boundary]]\non = \"right\"\ntraction = [0, 0, 0]",
                                      "[[boundary]]\non = \"left\"\ndisplacement = [\"0.1\", \"free\", \"free\"]");
  for (const char* essential : {"nitsche", "strong"})
    expect_matches(complaint<3>(replaced(pulled, "[material]",
                                         std::string("[analysis]\nessential = \"") + essential + "\"\n[material]"),
                                true),
                   R"(^case.toml: displacements prescribed on "plane 1" and .*"left" contradict each other at \(0, )");
  // Where they agree they count once.
  const Workspace work(replaced(pulled, "\"0.1\"", "0"));
  const auto result = solved<3>(work);
  EXPECT_LT(*result.errors->energy_norm, 1e-9);
}

// --- images and materials by region ----------------------------------------------------------------------------------

/// 8 x 4 pixels, label 1 on the left half and 2 on the right.
std::string two_labels() {
  std::string text = "P2\n# two materials\n8 4\n2\n";
  for (int row = 0; row < 4; ++row) text += "1 1 1 1 2 2 2 2\n";
  return text;
}

/// Two bars in a row, pixels of 0.25: u_x = x up to x = 1, then stiffer by ten; nu = 0.
const std::string image_case = R"(title = "two bars"
[geometry]
file = "labels.pgm"
mesh_size = 0.2
[geometry.image]
spacing = 0.25
regions = { 1 = "soft", 2 = "stiff" }
[cloud]
spacing = 0.5
[basis]
kind = "mls"
[analysis]
plane = "stress"
[[material]]
region = "soft"
E = 2
nu = 0
[[material]]
region = "stiff"
E = 20
nu = 0
[[boundary]]
on = "left"
displacement = [0, "free"]
[[boundary]]
on = { normal = [0, -1] }
displacement = ["free", 0]
[[boundary]]
on = "right"
traction = [2, 0]
[exact]
displacement = ["x < 1 ? x : 1 + (x - 1)/10", 0]
stress = [2, 0, 0]
[[probe]]
name = "middle"
at = [1.5, 0.5]
)";

TEST(ImageCase, EveryRegionHasItsOwnMaterial) {
  for (const char* kind : {"mls", "p1", "p2"}) {
    const Workspace work(replaced(image_case, "kind = \"mls\"", std::string("kind = \"") + kind + "\""));
    work.write("labels.pgm", two_labels());
    const auto run = work.efree(solve_here);
    ASSERT_EQ(run.status, 0) << run.output;
    const auto result = json(work / "out/result.json");
    EXPECT_EQ(result["dimension"], 2);
    EXPECT_EQ(result["counts"]["regions"], 2);
    EXPECT_EQ(result["regions"], (std::vector<std::string>{"soft", "stiff"}));
    EXPECT_LT(result["errors"]["l2_displacement"], 1e-9) << kind;
    EXPECT_LT(result["errors"]["energy_norm"], 1e-9) << kind;
    EXPECT_NEAR(result["probes"]["middle"]["displacement"][0], 1.05, 1e-9);
    EXPECT_NEAR(result["probes"]["middle"]["strain"][0], 0.1, 1e-9);
    EXPECT_NEAR(result["boundaries"]["left"]["length"], 1.0, 1e-12);
    // The interface is no part of the boundary, but the bottom goes on where the material changes.
    EXPECT_NEAR(result["boundaries"]["normal 1"]["length"], 2.0, 1e-12);
  }
}

/// The bars side by side, stretched by a tenth: stresses of 0.2 and 2 along y, which jump between them.
const std::string stretched_case =
    image_case.substr(0, image_case.find("[[boundary]]\non = \"right\"")) + R"([[boundary]]
on = { normal = [0, 1] }
displacement = ["free", 0.1]
[[probe]]
name = "between"
at = [1, 0.5]
[[reaction]]
name = "foot"
on = { normal = [0, -1] }
)";

TEST(ImageCase, StressesThatJumpBetweenRegionsAreToldAndWrittenByRegion) {
  for (const char* kind : {"mls", "p1", "p2"}) {
    const bool iterates = std::string(kind) == "mls";  // ends at a per cent
    const Workspace work(replaced(replaced(stretched_case, "kind = \"mls\"", std::string("kind = \"") + kind + "\""),
                                  "plane = \"stress\"",
                                  "plane = \"stress\"\nextremes = [\"displacement\", \"von_mises\"]"));
    work.write("labels.pgm", two_labels());
    ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--quiet"}).status, 0);
    const auto result = json(work / "out/result.json");
    const double small = iterates ? 1e-3 : 1e-9;
    EXPECT_LT(result["estimates"]["probes"]["between"], small) << kind;
    EXPECT_LT(result["estimates"]["reactions"]["foot"], small) << kind;
    EXPECT_NEAR(result["reactions"]["foot"]["force"][1], -2.2, 3.0 * small) << kind;
    EXPECT_NEAR(result["extremes"]["von_mises"]["value"], 2.0, 3.0 * small) << kind;
    EXPECT_LT(result["extremes"]["von_mises"]["error"], 3.0 * small) << kind;
    vtkNew<vtkXMLUnstructuredGridReader> reader;
    const std::string file = (work / "out/fields.vtu").string();
    reader->SetFileName(file.c_str());
    reader->Update();
    vtkUnstructuredGrid* grid = reader->GetOutput();
    vtkDataArray *stress = grid->GetPointData()->GetArray("stress"),
                 *u = grid->GetPointData()->GetArray("displacement"), *region = grid->GetCellData()->GetArray("region"),
                 *error = grid->GetCellData()->GetArray("error");
    vtkIdType between = 0;
    for (vtkIdType p = 0; p < grid->GetNumberOfPoints(); ++p) {
      between += std::abs(grid->GetPoint(p)[0] - 1.0) < 1e-12;
      ASSERT_NEAR(u->GetComponent(p, 1), 0.1 * grid->GetPoint(p)[1], small);
    }
    EXPECT_GE(between, 10) << kind;  // five pixel corners, once for each region
    EXPECT_EQ(between % 2, 0) << kind;
    for (vtkIdType c = 0; c < grid->GetNumberOfCells(); ++c) {
      const double expected = region->GetComponent(c, 0) == 0.0 ? 0.2 : 2.0;
      EXPECT_LT(error->GetComponent(c, 0), 10.0 * small) << kind;
      vtkIdList* points = grid->GetCell(c)->GetPointIds();
      for (vtkIdType i = 0; i < points->GetNumberOfIds(); ++i)
        ASSERT_NEAR(stress->GetComponent(points->GetId(i), 1), expected, 30.0 * small) << kind;
    }
  }
}

TEST(ImageCase, RegionsThatDoNotMatchAreErrorsThatListThoseThere) {
  const auto with = [](const std::string& from, const std::string& to) {
    const Workspace work(replaced(image_case, from, to));
    work.write("labels.pgm", two_labels());
    return complaint<2>(work);
  };
  expect_matches(with("region = \"stiff\"", "region = \"stif\""),
                 R"(^case.toml:19: no region is named "stif"; the mesh has "soft", "stiff")");
  expect_matches(with("[[material]]\nregion = \"stiff\"\nE = 20\nnu = 0\n", ""),
                 R"(^case.toml:15: no \[\[material\]\] for the region "stiff"; the mesh has "soft", "stiff")");
  expect_matches(with("region = \"stiff\"", "region = \"soft\""),
                 R"(^case.toml:19: the region "soft" has a material already, from case.toml:15)");
  expect_matches(with("region = \"stiff\"", ""), R"(^case.toml:18: key "region" is missing in \[\[material\]\])");
  expect_matches(with("2 = \"stiff\"", "3 = \"stiff\""), R"(^case.toml:3: .*3)");
  expect_matches(with("2 = \"stiff\"", "two = \"stiff\""), R"(^case.toml:7: "two" is no label)");
  expect_matches(with("spacing = 0.25", "spacing = [1, 1, 1]"), R"(^case.toml:6: spacing has 3 numbers, expected one)");
  expect_matches(with("spacing = 0.25", "below = true"), R"(^case.toml:6: below has no meaning for an image without)");
  expect_matches(with("spacing = 0.25", "facet_distance = 1"), R"(^case.toml:6: facet_distance has no meaning)");
  expect_matches(with("spacing = 0.25", "mesher = \"lattice\""),
                 R"(^case.toml:6: mesher has no meaning for an image in the plane)");
  expect_matches(with("mesh_size = 0.2", "mesh_size = 0.2\nslits = [\"crack\"]"),
                 R"(^case.toml:5: slits has no meaning for an image)");
}

TEST(ImageCase, OneMaterialMayFillAllRegions) {
  const std::string materials =
      "[[material]]\nregion = \"soft\"\nE = 2\nnu = 0\n[[material]]\nregion = \"stiff\"\nE = 20\nnu = 0";
  const Workspace work(replaced(replaced(image_case, materials, "[material]\nE = 2\nnu = 0"),
                                "\"x < 1 ? x : 1 + (x - 1)/10\"", "\"x\""));
  work.write("labels.pgm", two_labels());
  EXPECT_LT(*solved<2>(work).errors->energy_norm, 1e-9);
}

TEST(ImageCase, RawPicturesAndThresholds) {
  const std::string raw =
      replaced(replaced(image_case, "labels.pgm", "picture.raw"), "regions = { 1 = \"soft\", 2 = \"stiff\" }",
               "raw = { size = [8, 4], type = \"uint8\", header = 3 }\nregions = { 1 = \"soft\", 2 = \"stiff\" }");
  std::string bytes = "abc";
  for (int row = 0; row < 4; ++row) bytes += std::string("\x01\x01\x01\x01\x02\x02\x02\x02");
  {
    const Workspace work(raw);
    work.write("picture.raw", bytes);
    EXPECT_LT(*solved<2>(work).errors->energy_norm, 1e-9);
    work.write("picture.raw", bytes.substr(0, 20));
    expect_matches(complaint<2>(work), R"(^case.toml:3: .*picture.raw)");
    work.write("case.toml", replaced(raw, "size = [8, 4]", "size = [8.5, 4]"));
    expect_matches(complaint<2>(work), R"(^case.toml:7: size holds 8.5, expected numbers of pixels)");
    work.write("case.toml", replaced(raw, "raw = { size = [8, 4], type = \"uint8\", header = 3 }\n", ""));
    expect_matches(complaint<2>(work), R"(^case.toml:3: a .raw file needs)");
  }
  // Everything at least as bright as 2: the right half only.
  const Workspace work(replaced(replaced(raw, "regions = { 1 = \"soft\", 2 = \"stiff\" }", "threshold = 2"),
                                "[[material]]\nregion = \"soft\"\nE = 2\nnu = 0\n[[material]]\nregion = \"stiff\"",
                                "[[material]]\nregion = \"1\""));
  work.write("case.toml", replaced(content(work / "case.toml"), "on = \"left\"", "on = \"pores\""));
  work.write("picture.raw", bytes);
  const auto mesh = meshed<2>(work).mesh;
  EXPECT_NEAR(mesh->volumes().sum(), 1.0, 1e-12);
  EXPECT_NEAR(mesh->vertices().row(0).minCoeff(), 1.0, 1e-12);
}

TEST(ImageCase, IslandsThatAreLeftOutAreReported) {
  const Workspace work(replaced(replaced(image_case, "labels.pgm", "islands.pgm"),
                                "regions = { 1 = \"soft\", 2 = \"stiff\" }", "largest_only = true"));
  work.write("islands.pgm", "P2\n8 3\n1\n1 1 1 1 0 0 0 0\n1 1 1 1 0 1 0 0\n1 1 1 1 0 0 0 0\n");
  work.write("case.toml", replaced(content(work / "case.toml"),
                                   "[[material]]\nregion = \"soft\"\nE = 2\nnu = 0\n[[material]]\nregion = \"stiff\"",
                                   "[[material]]\nregion = \"1\""));
  work.write("case.toml", replaced(content(work / "case.toml"), "on = \"right\"", "on = \"pores\""));
  work.write("case.toml", replaced(content(work / "case.toml"), "at = [1.5, 0.5]", "at = [0.5, 0.5]"));
  const auto mesh = meshed<2>(work);
  ASSERT_EQ(mesh.reports.size(), 2u);
  EXPECT_EQ(mesh.reports[0], std::pair(std::string("islands_left_out"), Reported(Index(1))));
  EXPECT_NEAR(std::get<double>(mesh.reports[1].second), 1.0 / 13.0, 1e-12);
  EXPECT_NEAR(mesh.mesh->volumes().sum(), 12.0 / 16.0, 1e-12);
  ASSERT_EQ(work.efree({"solve", "case.toml", "--out", "out", "--quiet"}).status, 0);
  const auto reports = json(work / "out/result.json")["reports"];
  EXPECT_TRUE(reports["islands_left_out"].is_number_integer());
  EXPECT_TRUE(reports["islands_fraction"].is_number_float());
}

/// A bar of 8 x 3 pixels held on the left and pulled on the right, and an island of 2 beside it.
const std::string bar_and_island_case = R"([geometry]
file = "island.pgm"
mesh_size = 0.5
[cloud]
spacing = 1.5
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
traction = [0.1, 0]
)";
const std::string bar_and_island =
    "P2\n8 5\n1\n0 0 0 1 1 0 0 0\n0 0 0 0 0 0 0 0\n1 1 1 1 1 1 1 1\n1 1 1 1 1 1 1 1\n"
    "1 1 1 1 1 1 1 1\n";

TEST(ImageCase, BodiesNeitherHeldNorLoadedAreLeftOut) {
  const Workspace work(bar_and_island_case);
  work.write("island.pgm", bar_and_island);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  expect_matches(
      run.output,
      R"(1 body with 7.7 % of the volume neither held nor loaded and left out, the largest is the body around \(4, 4.5\); its nearest neighbour is the body around)");
  const auto result = json(work / "out/result.json");
  EXPECT_EQ(result["reports"]["free_bodies"], 1);
  EXPECT_NEAR(result["reports"]["free_bodies_fraction"], 2.0 / 26.0, 1e-12);
  EXPECT_NEAR(result["strain_energy"], 0.5 * 0.01 * 24.0, 1e-10);
  for (const char* kind : {"p1", "p2"}) {
    work.write("case.toml", bar_and_island_case + "[basis]\nkind = \"" + kind + "\"\n");
    EXPECT_NEAR(solved<2>(work).solution.strain_energy, 0.12, 1e-10) << kind;
  }
}

TEST(ImageCase, FreeBodiesThatAreLoadedOrLargestAreRefused) {
  const auto refusal = [](const std::string& text) {
    const Workspace work(text);
    work.write("island.pgm", bar_and_island);
    return complaint<2>(work, true);
  };
  const std::string island = R"(underconstrained: free to move \(body around \(4, 4.5\): translation along x)";
  expect_matches(refusal(bar_and_island_case + "[[boundary]]\non = \"top\"\npressure = 1\n"), island);
  expect_matches(refusal(replaced(bar_and_island_case, "plane =", "body_force = [0, -1]\nplane =")), island);
  expect_matches(refusal(replaced(bar_and_island_case, "\"left\"", "\"top\"")),
                 R"(underconstrained: free to move \(body around \(4, 1.5\): translation along x)");
  // A part of the case that would go with the body it is on.
  expect_matches(refusal(bar_and_island_case + "[[boundary]]\non = \"top\"\ndisplacement = [\"free\", 0]\n"),
                 R"(^case.toml:\d+: all of the boundary "top" is on bodies that are neither held nor loaded)");
}

TEST(ImageCase, VoxelsInSpace) {
  const Workspace work(R"([geometry]
file = "block.raw"
mesh_size = 1.5
image = { raw = { size = [6, 4, 4] }, spacing = [1, 1, 1] }
[cloud]
spacing = 2.5
[material]
E = 1
nu = 0.25
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
displacement = [0.6, 0, 0]
)");
  work.write("block.raw", std::string(6 * 4 * 4, '\x01'));
  const auto run = work.efree(solve_here);
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(work / "out/result.json");
  EXPECT_NEAR(result["boundaries"]["left"]["area"], 16.0, 0.2);
  // Held at both ends it is stiffer than free to contract, softer than held all over.
  EXPECT_GT(result["strain_energy"], 0.5 * 96 * 0.01);
  EXPECT_LT(result["strain_energy"], 0.5 * 96 * 0.01 * 1.2);
}

constexpr std::string_view held_block = R"([basis]
kind = "p1"
[material]
E = 1
nu = 0.25
[[boundary]]
on = "left"
displacement = [0, 0, 0]
[[boundary]]
on = "right"
traction = [0.01, 0, 0]
)";

TEST(ImageCase, VoxelsAreMeshedOnALatticeUnlessDelaunayIsAskedFor) {
  const auto block = [](const std::string& keys) {
    return "[geometry]\nfile = \"block.raw\"\nmesh_size = 2\n[geometry.image]\nraw = { size = [8, 4, 4] }\n" + keys +
           std::string(held_block);
  };
  const auto mesh_of = [&](const std::string& keys) {
    const Workspace work(block(keys));
    work.write("block.raw", std::string(8 * 4 * 4, '\x01'));
    return std::get<Case<3>>(read_case(work / "case.toml")).geometry.mesh({2.0}, {"mesh", {}});
  };
  const MadeMesh<3> lattice = mesh_of("mesher = \"lattice\"\n");
  EXPECT_EQ(lattice.mesh.cells.cols(), 4 * 2 * 2 * 6);
  EXPECT_EQ(mesh_of("").mesh.cells, lattice.mesh.cells);
  ASSERT_EQ(lattice.remarks.size(), 1u);
  expect_matches(lattice.remarks[0], "image: 8 x 4 x 4 voxels, spacing 1 x 1 x 1 .nothing says it");
  EXPECT_NE(mesh_of("mesher = \"delaunay\"\nfacet_distance = 0.5\n").mesh.cells.cols(), lattice.mesh.cells.cols());

  const auto failure = [&](const std::string& keys) {
    const Workspace work(block(keys));
    work.write("block.raw", std::string(8 * 4 * 4, '\x01'));
    return complaint<3>(work);
  };
  expect_matches(failure("facet_distance = 0.5\n"), "facet_distance has no meaning for an image on a lattice");
  expect_matches(failure("mesher = \"octree\"\n"), "octree.*lattice.*delaunay");
}

TEST(ImageCase, SaysWhatIsTooThinForTheLattice) {
  const Workspace work("[geometry]\nfile = \"block.raw\"\nmesh_size = 4\nimage = { raw = { size = [8, 8, 16] } }\n" +
                       std::string(held_block));
  std::string voxels(8 * 8 * 16, '\x01');
  // A block, void, and in it a plate of one voxel that no plane of points meets.
  for (int k = 8; k < 16; ++k) std::fill_n(voxels.begin() + 64 * k, 64, k == 13 ? '\x01' : '\x00');
  work.write("block.raw", voxels);
  const auto run = work.efree({"solve", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  expect_matches(run.output,
                 "1 bodies or pores and 0 pieces of others are not in the mesh, volume 64.*a body of \"1\".*13.5");
  const auto reports = json(work / "out/result.json")["reports"];
  EXPECT_EQ(reports["lost_parts"], 1);
  EXPECT_EQ(reports["lost_volume"], 64.0);
}

// --- surfaces --------------------------------------------------------------------------------------------------------

/// Text STL of the unit cube, n x n squares of two triangles to a side, the first `missing` triangles left out.
std::string cube_stl(int n = 1, int missing = 0, double height = 1.0) {
  std::ostringstream text;
  text << "solid cube\n";
  const auto corner = [&](const Vec<3>& x) {
    text << "vertex " << x[0] << ' ' << x[1] << ' ' << x[2] * height << '\n';
  };
  for (int d = 0; d < 3; ++d)
    for (int side = 0; side < 2; ++side)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
          for (int half = 0; half < 2; ++half) {
            if (missing-- > 0) continue;
            const auto at = [&](int a, int b) {
              Vec<3> x;
              x[d] = side;
              x[(d + 1) % 3] = (i + a) / static_cast<double>(n);
              x[(d + 2) % 3] = (j + b) / static_cast<double>(n);
              return x;
            };
            std::array<Vec<3>, 3> t{at(0, 0), at(1, half), half ? at(0, 1) : at(1, 1)};
            if (half) t = {at(0, 0), at(1, 1), at(0, 1)};
            if (side == 0) std::swap(t[1], t[2]);
            text << "facet normal 0 0 0\nouter loop\n";
            for (const Vec<3>& x : t) corner(x);
            text << "endloop\nendfacet\n";
          }
  text << "endsolid cube\n";
  return text.str();
}

const std::string surface_case = R"(title = "cube"
[geometry]
file = "cube.stl"
mesh_size = 0.5
[cloud]
spacing = 0.6
[basis]
kind = "mls"
[material]
E = 1
nu = 0.25
[[boundary]]
on = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }
displacement = ["free", "free", 0]
[[boundary]]
on = { normal = [-1, 0, 0], angle = 5 }
normal_displacement = 0
[[boundary]]
on = { nearest = [0.5, -1, 0.5] }
normal_displacement = 0
[[boundary]]
on = { box = [[0, 0, 1], [1, 1, 1]] }
pressure = -1
[exact]
displacement = ["-0.25*x", "-0.25*y", "z"]
stress = [0, 0, 1, 0, 0, 0]
)";

TEST(SurfaceCase, ACubeFromTrianglesIsPulledExactly) {
  const Workspace work(surface_case);
  work.write("cube.stl", cube_stl());
  const auto run = work.efree(solve_here);
  ASSERT_EQ(run.status, 0) << run.output;
  const auto result = json(work / "out/result.json");
  for (const char* error : {"l2_displacement", "energy_norm", "energy_norm_recovered"})
    EXPECT_LT(result["errors"][error], 1e-9) << error;
  for (const char* part : {"plane 1", "normal 1", "nearest 1", "box 1"})
    EXPECT_NEAR(result["boundaries"][part]["area"], 1.0, 1e-9) << part;
}

TEST(SurfaceCase, AHoleIsRefusedOrWrapped) {
  const Workspace work(surface_case);
  work.write("cube.stl", cube_stl(4, 1));
  expect_matches(complaint<3>(work), R"(^case.toml:3: .*open)");
  // The wrap lies a little outside: parts are found by the way they face.
  std::string wrapped = replaced(surface_case, "mesh_size = 0.5",
                                 "mesh_size = 0.5\nsurface = { wrap = true, alpha = 0.5, offset = 0.05 }");
  wrapped =
      replaced(wrapped, "{ plane = { point = [0, 0, 0], normal = [0, 0, 1] } }", "{ normal = [0, 0, -1], angle = 5 }");
  wrapped = replaced(wrapped, "{ box = [[0, 0, 1], [1, 1, 1]] }", "{ normal = [0, 0, 1], angle = 5 }");
  wrapped = replaced(wrapped, "kind = \"mls\"", "kind = \"p1\"\n[analysis]\nessential = \"nitsche\"");
  work.write("case.toml", wrapped);
  const auto run = work.efree({"solve", "case.toml", "--out", "out", "--no-picture"});
  ASSERT_EQ(run.status, 0) << run.output;
  EXPECT_NE(run.output.find("wrap: alpha 0.5, offset 0.05;"), std::string::npos) << run.output;
  EXPECT_NE(run.output.find("boundary \"normal 1\": "), std::string::npos) << run.output;
  const auto reports = json(work / "out/result.json")["reports"];
  EXPECT_NEAR(reports["wrap_volume"], 1.2, 0.15);
  EXPECT_GT(reports["wrap_max_distance"], 0.049);
  EXPECT_LT(reports["wrap_max_distance"], 0.3);
  EXPECT_EQ(reports["wrap_alpha"], 0.5);
  expect_matches(complaint<3>(replaced(surface_case, "mesh_size = 0.5", "mesh_size = 0.5\nsurface = { alpha = 0.1 }")),
                 R"(^case.toml:3: there is no file cube.stl)");
  work.write("case.toml", replaced(surface_case, "mesh_size = 0.5", "mesh_size = 0.5\nsurface = { alpha = 0.1 }"));
  expect_matches(complaint<3>(work), R"(^case.toml:5: alpha has no meaning for a surface that is not wrapped)");
}

TEST(SurfaceCase, AHoleIsClosedOnALattice) {
  const Workspace work(surface_case);
  work.write("cube.stl", cube_stl(4, 1));
  std::string text = replaced(surface_case, "mesh_size = 0.5", "mesh_size = 0.1\nsurface = { mesher = \"lattice\" }");
  text =
      replaced(text, "{ plane = { point = [0, 0, 0], normal = [0, 0, 1] } }", "{ box = [[0, 0, -0.1], [1, 1, 0.05]] }");
  text = replaced(text, "{ box = [[0, 0, 1], [1, 1, 1]] }", "{ box = [[0, 0, 0.95], [1, 1, 1.1]] }");
  work.write("case.toml", text);
  const auto run = work.efree({"inspect", "case.toml", "--out", "out"});
  ASSERT_EQ(run.status, 0) << run.output;
  const auto seen = json(work / "out/inspection.json");
  EXPECT_NEAR(seen["volume"], 1.0, 0.04);  // the edges are cut off
  EXPECT_GT(seen["facts"]["closed_fraction"], 0.0);
  work.write("case.toml", replaced(text, "\"lattice\" }", "\"lattice\", wrap = true }"));
  expect_matches(complaint<3>(work), R"(^case.toml:.*wrap has no meaning for a surface on a lattice)");
}

/// OFF file of a surface.
std::string off(const SurfaceSoup& soup) {
  std::ostringstream text;
  text.precision(10);
  text << "OFF\n" << soup.points.cols() << ' ' << soup.triangles.size() << " 0\n";
  for (const auto& x : soup.points.colwise()) text << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
  for (const auto& t : soup.triangles) text << "3 " << t[0] << ' ' << t[1] << ' ' << t[2] << '\n';
  return text.str();
}

/// A ball under pressure: its strain energy is to its volume as everywhere.
TEST(SurfaceCase, WhatTrianglesOfABallLeaveIsInTheEstimatesAndThatOfACubeIsNone) {
  const Workspace work(R"([geometry]
file = "ball.off"
mesh_size = 0.5
[basis]
kind = "p2"
[material]
E = 1
nu = 0.3
[[boundary]]
on = "surface 1"
pressure = 1
[[boundary]]
on = { nearest = [0, 0, 2] }
stiffness = 1e-6
)");
  for (const int rings : {6, 12}) {
    work.write("ball.off", off(sphere_surface({0, 0, 0}, 1.0, rings)));
    const auto result = analyse(std::get<Case<3>>(read_case(work / "case.toml")));
    const double truth = 4.0 / 3.0 * std::numbers::pi * 1.5 * (1.0 - 2.0 * 0.3);
    const double off_by = std::sqrt(std::abs(truth / result.solution.strain_energy - 1.0));
    EXPECT_GT(off_by, 0.03);
    EXPECT_GT(result.estimates->geometry, 0.5 * off_by) << rings;
    EXPECT_LT(result.estimates->geometry, 2.0 * off_by) << rings;
  }
  work.write("cube.stl", cube_stl(4));
  work.write("case.toml", surface_case);
  EXPECT_EQ(analyse(std::get<Case<3>>(read_case(work / "case.toml"))).estimates->geometry, 0.0);
}

TEST(SurfaceCase, ASlitThatTheMeshClosesIsAWarningOfResultAndInspection) {
  const Workspace work(R"([geometry]
file = "fork.off"
mesh_size = 1
surface = { mesher = "lattice" }
[basis]
kind = "p2"
[material]
E = 1000
nu = 0.3
[[boundary]]
on = { box = [[-1, -1, -1], [0.6, 5, 4.9]] }
displacement = [0, 0, 0]
[[boundary]]
on = { box = [[-1, -1, 5.2], [0.6, 5, 11]] }
traction = [0, 0, 1e-3]
)");
  work.write("fork.off", off(fork_surface(0.03)));
  const auto run = work.efree(solve_here);
  ASSERT_EQ(run.status, 0) << run.output;
  const auto reports = json(work / "out/result.json")["reports"];
  EXPECT_EQ(reports["closed_gaps"], 1);
  const std::string told = "closes 1 gap of the surface, 0.03 wide at (";
  const auto has = [&](const nlohmann::json& texts) {
    return std::ranges::any_of(
        texts, [&](const auto& text) { return text.template get<std::string>().find(told) != std::string::npos; });
  };
  EXPECT_TRUE(has(reports["warnings"])) << reports;
  EXPECT_NE(run.output.find(told), std::string::npos) << run.output;
  ASSERT_EQ(work.efree({"inspect", "case.toml", "--out", "seen"}).status, 0);
  EXPECT_TRUE(has(json(work / "seen/inspection.json")["remarks"]));
  // The file alone has no mesh yet.
  ASSERT_EQ(work.efree({"inspect", "fork.off", "--out", "file"}).status, 0);
  const auto seen = json(work / "file/inspection.json");
  EXPECT_EQ(seen["facts"]["narrow_gaps"], 1);
  EXPECT_NEAR(seen["facts"]["narrowest_gap"], 0.03, 1e-6);
}

TEST(SurfaceCase, BodiesWithAGapBetweenThemAreNotOne) {
  const Workspace work(R"([geometry]
file = "two.off"
mesh_size = 2
[material]
E = 1000
nu = 0
[[boundary]]
on = { plane = { point = [0, 0, 0], normal = [1, 0, 0] } }
displacement = [0, 0, 0]
[[boundary]]
on = { plane = { point = [8.00001, 0, 0], normal = [1, 0, 0] } }
traction = [10, 0, 0]
)");
  SurfaceSoup two = together(box_surface({0, 0, 0}, {4, 2, 2}), box_surface({4.00001, 0, 0}, {8.00001, 2, 2}));
  work.write("two.off", off(two));
  const auto run = work.efree(solve_here);
  EXPECT_EQ(run.status, 2) << run.output;
  EXPECT_NE(run.output.find("free"), std::string::npos) << run.output;
}

// --- shapes and graded clouds ----------------------------------------------------------------------------------------

TEST(ShapeCase, EveryShapeCanBeNamed) {
  const auto mesh_of = [](const std::string& geometry, const std::string& part, bool planar) {
    return Workspace("[geometry]\n" + geometry + "\n[cloud]\nspacing = 1\n[material]\nE = 1\nnu = 0\n" +
                     (planar ? "[analysis]\nplane = \"strain\"\n" : "") + "[[boundary]]\non = \"" + part +
                     "\"\npressure = 1\n");
  };
  const auto area = [&](const std::string& geometry, const std::string& part) {
    const Workspace work(mesh_of(geometry, part, true));
    return meshed<2>(work).mesh->volumes().sum();
  };
  const auto volume = [&](const std::string& geometry, const std::string& part) {
    const Workspace work(mesh_of(geometry, part, false));
    return meshed<3>(work).mesh->volumes().sum();
  };
  constexpr double pi = 3.14159265358979;
  EXPECT_NEAR(area("shape = \"rectangle\"\nmesh_size = 0.5\nparameters = { width = 2, height = 3, x = -1 }", "top"),
              6.0, 1e-12);
  EXPECT_NEAR(area("shape = \"plate_with_hole\"\nmesh_size = 0.2\nparameters = { radius = 1, half_width = 2 }", "hole"),
              4.0 - pi / 4, 0.01);
  EXPECT_NEAR(area("shape = \"l_shape\"\nmesh_size = 0.5\nparameters = { side = 2 }", "notch"), 3.0, 1e-12);
  EXPECT_NEAR(area("shape = \"cook\"\nmesh_size = 8", "right"), 1440.0, 1e-9);
  EXPECT_NEAR(area("shape = \"annulus\"\nmesh_size = 0.2\nparameters = { inner = 1, outer = 2 }", "inner"), 3 * pi,
              0.1);
  EXPECT_NEAR(area("shape = \"random_holes\"\nmesh_size = 0.5\nparameters = { width = 10, count = 3, r_min = 1, r_max "
                   "= 1, gap = 0.2, seed = 4 }",
                   "holes"),
              100.0 - 3 * pi, 0.3);
  EXPECT_NEAR(volume("shape = \"cylinder\"\nmesh_size = 0.8\nparameters = { radius = 1, height = 2 }", "side"), 2 * pi,
              0.25);
  EXPECT_NEAR(volume("shape = \"thick_sphere\"\nmesh_size = 0.8\nparameters = { inner = 1, outer = 2, size_at_inner = "
                     "0.2 }",
                     "inner"),
              7 * pi / 6, 0.15);
  EXPECT_NEAR(volume("shape = \"thick_cylinder\"\nmesh_size = 0.8\nparameters = { inner = 1, outer = 2, height = 1, "
                     "size_at_inner = 0.2 }",
                     "inner"),
              0.75 * pi, 0.1);
  EXPECT_NEAR(volume("shape = \"thick_sphere\"\nmesh_size = 0.8\nparameters = { inner = 1, outer = 2 }", "inner"),
              7 * pi / 6, 0.2);
  const auto wrong = [&](const std::string& geometry) { return complaint<2>(mesh_of(geometry, "left", true)); };
  expect_matches(wrong("shape = \"rectangel\"\nmesh_size = 1"),
                 R"(^case.toml:2: there is no shape "rectangel"; did you mean "rectangle"\?)");
  expect_matches(wrong("shape = \"rectangle\"\nmesh_size = 1"),
                 R"(^case.toml:2: the shape "rectangle" needs width, height)");
  expect_matches(wrong("shape = \"l_shape\"\nmesh_size = 1\nparameters = { side = 1, sides = 2 }"),
                 R"(^case.toml:4: unknown key "sides" in \[geometry.parameters\]; did you mean "side"\?)");
  expect_matches(
      wrong("shape = \"random_holes\"\nmesh_size = 1\nparameters = { width = 9, gap = 1, count = 1.5, r_min = 1, r_max "
            "= 1 }"),
      R"(^case.toml:4: count is 1.5, expected a whole number)");
  expect_matches(wrong("shape = \"cook\"\nfile = \"x.geo\"\nmesh_size = 1"),
                 "both file and shape, expected exactly one");
}

TEST(GradedCase, BoxesRegionsAndFeaturesMakeTheCloudDenser) {
  const auto nodes = [](const std::string& grading) {
    const Workspace work(replaced(strip_case, "seed = 1", "seed = 1\n" + grading));
    const auto result = solved<2>(work);
    EXPECT_LT(*result.errors->energy_norm, 1e-9) << grading;  // a patch test on any cloud
    return result.approximation.nodes;
  };
  const auto left = [](const Points<2>& points) { return (points.row(0).array() <= 0.5).count(); };
  const Points<2> uniform = nodes("");
  const Points<2> boxed = nodes("boxes = [{ box = [[-1, -1], [0.5, 2]], spacing = 0.15 }]");
  EXPECT_GT(left(boxed), 3 * left(uniform));
  EXPECT_LT((boxed.row(0).array() > 1.5).count(), 2 * (uniform.row(0).array() > 1.5).count());
  const Points<2> slowly = nodes("growth = 0.05\nboxes = [{ box = [[-1, -1], [0.5, 2]], spacing = 0.15 }]");
  EXPECT_GT(slowly.cols(), boxed.cols());
  const Points<2> everywhere = nodes("regions = [{ region = \"strip\", spacing = 0.2 }]");
  EXPECT_GT(everywhere.cols(), 2 * uniform.cols());
  const Points<2> towards = nodes("boundaries = [{ on = \"left\", spacing = 0.15 }]");
  EXPECT_GT(left(towards), 2 * left(uniform));
  EXPECT_EQ(nodes("boundaries = [{ on = { plane = { point = [0, 0], normal = [1, 0] } }, spacing = 0.15 }]"), towards);

  const auto with_holes = [](const std::string& features) {
    const Workspace work(
        "[geometry]\nshape = \"random_holes\"\nmesh_size = 0.05\nparameters = { width = 4, count = 6, r_min = 0.2, "
        "r_max = 0.2, gap = 0.3 }\n[cloud]\nspacing = 1\n" +
        features +
        "[analysis]\nplane = \"strain\"\n[material]\nE = 1\nnu = 0.3\n[[boundary]]\non = \"left\"\n"
        "displacement = [0, 0]\n");
    return solved<2>(work).approximation.nodes.cols();
  };
  EXPECT_GT(with_holes("features = true\n"), 1.5 * with_holes(""));
}

TEST(GradedCase, CloudsInSpaceGrowFromASelectedPartWhichIsReported) {
  const auto solved_box = [](const std::string& grading) {
    const Workspace work(
        "[geometry]\nshape = \"box\"\nmesh_size = 0.1\nparameters = { width = 2, depth = 0.5, height = 0.5 }\n"
        "[cloud]\nspacing = 0.5\n" +
        grading +
        "[material]\nE = 1\nnu = 0.3\n[[boundary]]\non = \"left\"\ndisplacement = [0, 0, 0]\n"
        "[[boundary]]\non = \"right\"\ntraction = [1, 0, 0]\n");
    return solved<3>(work);
  };
  const auto uniform = solved_box("");
  const auto graded = solved_box("boundaries = [{ on = { nearest = [2, 0.2, 0.2] }, spacing = 0.2 }]\n");
  const auto beyond = [](const auto& result) { return (result.approximation.nodes.row(0).array() > 1.5).count(); };
  EXPECT_GT(beyond(graded), 3 * beyond(uniform));
  ASSERT_EQ(graded.parts.size(), 3u);
  EXPECT_EQ(graded.parts.back().name, "nearest 1");
  EXPECT_NEAR(graded.parts.back().measure, 0.25, 1e-12);
}

TEST(GradedCase, RefusesWhatMakesNoSense) {
  const auto with = [](const std::string& grading) {
    return complaint<2>(replaced(strip_case, "seed = 1", "seed = 1\n" + grading), true);
  };
  expect_matches(with("growth = 0"), R"(^case.toml:8: growth is 0, expected a number > 0)");
  expect_matches(with("features = 1"), R"(^case.toml:8: features is 1, expected true or false)");
  expect_matches(with("boxes = [{ box = [[0, 0], [1, 1]] }]"), R"(^case.toml:8: key "spacing" is missing)");
  expect_matches(with("boxes = [{ box = [[7, 7], [8, 8]], spacing = 0.2 }]"), R"(^case.toml.*7)");
  expect_matches(with("regions = [{ region = \"stripe\", spacing = 0.2 }]"),
                 R"(^case.toml:8: no region is named "stripe"; the mesh has "strip")");
  expect_matches(with("boundaries = [{ on = \"wall\", spacing = 0.2 }]"),
                 R"(^case.toml:8: no part of the boundary is named "wall")");
  expect_matches(with("boundaries = [{ on = \"left\" }]"),
                 R"(^case.toml:8: key "spacing" is missing in \[\[cloud.boundaries\]\])");
  for (const std::string spacing : {"0", "-1", "nan", "\"x\""})
    expect_matches(with("boundaries = [{ on = \"left\", spacing = " + spacing + " }]"),
                   R"(^case.toml:8: spacing is .*, expected a number > 0)");
  expect_matches(with("boundaries = \"left\""),
                 R"(^case.toml:8: boundaries must be written \[\[cloud.boundaries\]\], once for each entry)");
  expect_matches(with("boundaries = [{ boundary = \"left\", spacing = 0.2 }]"), R"(^case.toml:8: .*"boundary")");
  expect_matches(with("boundaries = [{ on = { box = [[7, 7], [8, 8]] }, spacing = 0.2 }]"),
                 R"(^case.toml:8: the selection "box 1" is empty)");
  expect_matches(
      complaint<2>(
          "[geometry]\nshape = \"l_shape\"\nmesh_size = 0.5\nparameters = { side = 2 }\n[cloud]\nspacing = 1\n"
          "regions = [{ region = \"grain\", spacing = 0.5 }]\n[analysis]\nplane = \"strain\"\n[material]\nE = 1\n"
          "nu = 0\n[[boundary]]\non = \"left\"\ndisplacement = [0, 0]\n",
          true),
      R"(^case.toml:7: no region is named "grain"; the mesh has one region without a name)");
  expect_matches(with("boxes = 3"), R"(^case.toml:8: boxes must be written)");
}

// --- wrong input: one message, exit status 2, nothing written
// -----------------------------------------------------------

struct WrongFile {
  const char* name;
  std::string content;
  const char* message;
};
class WrongGeometry : public testing::TestWithParam<WrongFile> {};

TEST_P(WrongGeometry, IsRefusedWithOneMessage) {
  const auto& [name, text, message] = GetParam();
  const bool planar = std::regex_search(name, std::regex("pgm|png|geo|raw|tif"));
  const Workspace work("[geometry]\nfile = \"" + std::string(name) + "\"\nmesh_size = 0.5\n" +
                       (std::string(name).ends_with(".raw") ? "image = { raw = { size = [4, 4] } }\n" : "") +
                       "[cloud]\nspacing = 1\n[material]\nE = 1\nnu = 0\n" +
                       (planar ? "[analysis]\nplane = \"strain\"\n" : "") + "[[boundary]]\non = { " +
                       (planar ? "normal = [1, 0]" : "normal = [1, 0, 0]") + " }\npressure = 1\n");
  if (text != "missing") work.write(name, text);
  const auto run = work.efree(solve_here);
  EXPECT_EQ(run.status, 2) << run.output;
  EXPECT_TRUE(std::regex_search(run.output, std::regex(std::string("^error: case.toml:2: .*") + message)))
      << run.output << "\nexpected: " << message;
  EXPECT_EQ(std::ranges::count(run.output, '\n'), 1) << run.output;
  EXPECT_FALSE(fs::exists(work / "out"));
}

std::string binary_stl(unsigned triangles, std::size_t bytes) {
  std::string text(80, ' ');
  for (int k = 0; k < 4; ++k) text += static_cast<char>(triangles >> (8 * k) & 0xff);
  text.resize(84 + bytes, '\0');
  return text;
}

INSTANTIATE_TEST_SUITE_P(
    Images, WrongGeometry,
    testing::Values(WrongFile{"none.pgm", "missing", "there is no file none.pgm"},
                    WrongFile{"a.pgm", "", "a.pgm.*empty"}, WrongFile{"a.png", "", "a.png.*empty"},
                    WrongFile{"a.nrrd", "", "a.nrrd.*empty"},
                    WrongFile{"a.pgm", "P5\n4 4\n255\nabc", "a.pgm.*(truncated|ends|bytes|short)"},
                    WrongFile{"a.pgm", "P2\n4 4\n255\n1 2 3", "a.pgm.*(truncated|ends|short)"},
                    WrongFile{"a.png", "GIF89a is no PNG", "a.png.*PNG"}, WrongFile{"a.tif", "GIF89a", "a.tif.*TIFF"},
                    WrongFile{"a.mha", "hello", "a.mha.*"}, WrongFile{"a.nrrd", "NRXX0004\n", "a.nrrd.*NRRD"},
                    WrongFile{"a.pgm", "P2\n2 2\n255\n0 0 0 0", "a.pgm.*background"},
                    WrongFile{"a.raw", "123", "a.raw.*(3|16)"},
                    WrongFile{"a.xyz", "1", "a.xyz: a file of unknown kind, expected a name that ends in .geo, .msh"}));

INSTANTIATE_TEST_SUITE_P(
    Surfaces, WrongGeometry,
    testing::Values(WrongFile{"none.stl", "missing", "there is no file none.stl"},
                    WrongFile{"a.stl", "", "a.stl.*empty"}, WrongFile{"a.off", "", "a.off.*empty"},
                    WrongFile{"a.stl", binary_stl(12, 100), "a.stl.*(truncated|ends|bytes|short)"},
                    WrongFile{"a.off", "OFX\n", "a.off.*"}, WrongFile{"a.ply", "plx\n", "a.ply.*"},
                    WrongFile{"a.stl", cube_stl(1, 1), "open"},
                    WrongFile{"a.stl", cube_stl(1, 0, 0.0), "a.stl|surface"},
                    WrongFile{"a.stl",
                              "solid x\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
                              "0\nendloop\nendfacet\nendsolid x\n",
                              "open"}));

INSTANTIATE_TEST_SUITE_P(CadFiles, WrongGeometry,
                         testing::Values(WrongFile{"none.step", "missing", "there is no file none.step"},
                                         WrongFile{"a.step", "", "a.step.*empty"},
                                         WrongFile{"a.step", "this is no STEP", "a.step"},
                                         WrongFile{"a.msh", "", "a.msh.*empty"}, WrongFile{"a.msh", "$Mesh", "a.msh"},
                                         WrongFile{"a.geo", "Point(1) = {", "a.geo"}));

TEST(Memory, IsAskedForBeforeItIsTaken) {
  for (const auto& [text, from, to] : std::vector<std::tuple<std::string, std::string, std::string>>{
           {replaced(strip_case, "file = \"strip.geo\"",
                     "shape = \"rectangle\"\nparameters = { width = 2, height = 1 }"),
            "mesh_size = 0.1", "mesh_size = 1e-5"},
           {strip_case, "mesh_size = 0.1", "mesh_size = 1.4e-4"},
           {bar_case, "mesh_size = 0.4", "mesh_size = 0.0011"}}) {
    const Workspace work(replaced(text, from, to));
    const auto run = work.efree(solve_here);
    EXPECT_EQ(run.status, 2) << run.output;
    EXPECT_TRUE(
        std::regex_search(run.output, std::regex("^error: case.toml:[0-9]+: .* GiB of memory, .* are available")))
        << run.output;
  }
}

}  // namespace
}  // namespace efree::test
