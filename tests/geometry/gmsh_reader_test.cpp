// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "files.hpp"
#include "meshes.hpp"

#include <omp.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using test::euler_characteristic;
using test::expect_consistent;
using test::file;
using test::length;

using std::numbers::pi;

const char* const plate_script = R"(
radius = DefineNumber[1, Name "Parameters/radius"];
width = DefineNumber[4, Name "Parameters/width"];
Point(1) = {0, 0, 0}; Point(2) = {radius, 0, 0}; Point(3) = {width, 0, 0}; Point(4) = {width, width, 0};
Point(5) = {0, width, 0}; Point(6) = {0, radius, 0};
Line(1) = {2, 3}; Line(2) = {3, 4}; Line(3) = {4, 5}; Line(4) = {5, 6}; Circle(5) = {6, 1, 2};
Curve Loop(1) = {1, 2, 3, 4, 5}; Plane Surface(1) = {1};
Physical Curve("bottom") = {1}; Physical Curve("right") = {2}; Physical Curve("top") = {3};
Physical Curve("left") = {4}; Physical Curve("hole") = {5}; Physical Curve("outside") = {2, 3};
Physical Surface("plate") = {1};
)";

void expect_plate(const FineMesh<2>& mesh, double radius, double width, double size) {
  expect_consistent(mesh);
  EXPECT_EQ(euler_characteristic(mesh), 1);
  EXPECT_EQ(mesh.groups().size(), 6u);
  EXPECT_NEAR(length(mesh, "left"), width - radius, 1e-12 * width);
  EXPECT_NEAR(length(mesh, "bottom"), width - radius, 1e-12 * width);
  EXPECT_NEAR(length(mesh, "right"), width, 1e-12 * width);
  EXPECT_NEAR(length(mesh, "top"), width, 1e-12 * width);
  EXPECT_NEAR(length(mesh, "outside"), 2.0 * width, 1e-12 * width);
  // Chords c of a circle cut off c^2 / (6 r^2) of the segment and c^2 / (24 r^2) of the length.
  const double relative = size * size / (radius * radius), arc = 0.5 * pi * radius;
  EXPECT_LE(length(mesh, "hole"), arc);
  EXPECT_GE(length(mesh, "hole"), arc * (1.0 - relative / 20.0));
  const double area = width * width - 0.25 * pi * radius * radius;
  EXPECT_GE(mesh.volumes().sum(), area * (1.0 - 1e-12));
  EXPECT_LE(mesh.volumes().sum(), area + 0.25 * pi * radius * radius * relative / 5.0);
  for (const Index f : mesh.group("hole"))
    for (const Index v : mesh.facets().col(f)) EXPECT_NEAR(mesh.vertex(v).norm(), radius, size * size / (7.0 * radius));
}

TEST(GmshReader, PlateWithHoleHasItsSizeAndGroups) {
  const std::string path = file("plate.geo", plate_script);
  for (const double size : {0.3, 0.1}) {
    const FineMesh<2> mesh(read_gmsh<2>(path, {.size = size}));
    expect_plate(mesh, 1.0, 4.0, size);
    EXPECT_LE(mesh.size(), size * (1.0 + 1e-12));
    EXPECT_GE(mesh.size(), 0.8 * size);
  }
}

TEST(GmshReader, ParametersAreKnownByFullAndShortName) {
  const std::string path = file("plate.geo", plate_script);
  expect_plate(
      FineMesh<2>(read_gmsh<2>(path, {.size = 0.2, .parameters = {{"radius", 0.75}, {"Parameters/width", 3.0}}})), 0.75,
      3.0, 0.2);
  EXPECT_INPUT_ERROR(read_gmsh<2>(path, {.size = 0.2, .parameters = {{"radios", 0.75}}}),
                     "unknown parameter \"radios\"; the file defines Parameters/radius, Parameters/width");
}

TEST(GmshReader, WithoutASizeTheFilesOwnSizesHold) {
  const std::string path = file("plate.geo", std::string(plate_script) + "Mesh.MeshSizeMax = 0.25;\n");
  const FineMesh<2> mesh(read_gmsh<2>(path));
  expect_plate(mesh, 1.0, 4.0, 0.3);
  EXPECT_LT(mesh.size(), 0.5);
  EXPECT_GT(mesh.num_cells(), 200);
}

TEST(GmshReader, FinerSizesOfTheFileAreKept) {
  const FineMesh<2> mesh(
      read_gmsh<2>(file("plate.geo", std::string(plate_script) + "MeshSize{:} = 0.05;\n"), {.size = 0.3}));
  expect_plate(mesh, 1.0, 4.0, 0.05);
  EXPECT_GE(mesh.group("bottom").size(), 60u);
  EXPECT_GT(mesh.size(), 0.2);
}

TEST(GmshReader, AFactorScalesTheFilesOwnSizesBelowTheSize) {
  const std::string path = file("dense.geo", std::string(plate_script) + "MeshSize{:} = 0.05;\n");
  const FineMesh<2> mesh(read_gmsh<2>(path, {.size = 0.3})), coarser(read_gmsh<2>(path, {.size = 0.3, .factor = 2.0}));
  EXPECT_NEAR(static_cast<double>(coarser.group("bottom").size()) / mesh.group("bottom").size(), 0.5, 0.05);
  EXPECT_GT(coarser.size(), 0.2);
  EXPECT_LE(coarser.size(), 0.3 * (1.0 + 1e-12));
}

TEST(GmshReader, AFactorLeavesASphereSixteenFacetsToATurn) {
  const std::string path = file("ball.geo", R"(SetFactory("OpenCASCADE"); Sphere(1) = {0, 0, 0, 1};
)");
  for (const double factor : {1.0, 2.25}) {
    const FineMesh<3> mesh(read_gmsh<3>(path, {.size = 2.0, .factor = factor}));
    double area = 0.0;
    for (Index f = 0; f < mesh.num_facets(); ++f) area += mesh.facet_measure(f);
    const double edge = 2.0 * pi / 16.0;
    EXPECT_LT(area / mesh.num_facets(), 0.25 * std::sqrt(3.0) * edge * edge) << "factor " << factor;
  }
}

TEST(GmshReader, SmallCirclesAreSampledFinely) {
  const std::string path = file("holes.geo", R"(SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1}; Disk(2) = {0.5, 0.5, 0, 0.01};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Physical Curve("all") = Boundary{ Surface{3}; };
)");
  const FineMesh<2> mesh(read_gmsh<2>(path, {.size = 0.2}));
  expect_consistent(mesh);
  EXPECT_EQ(euler_characteristic(mesh), 0);
  EXPECT_NEAR(length(mesh, "all"), 4.0 + 2.0 * pi * 0.01, 0.007 * 2.0 * pi * 0.01);
  EXPECT_NEAR(mesh.volumes().sum(), 1.0 - pi * 1e-4, 0.03 * pi * 1e-4);
}

const char* const two_squares = R"(
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {1, 1, 0}; Point(4) = {0, 1, 0}; Point(5) = {2, 0, 0}; Point(6) = {2, 1, 0};
Point(7) = {0.3, 0.3, 0}; Point(8) = {0.7, 0.6, 0}; Point(9) = {0.2, 0.8, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(5) = {2, 5}; Line(6) = {5, 6}; Line(7) = {6, 3}; Line(8) = {7, 8};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {5, 6, 7, -2}; Plane Surface(2) = {2};
Curve{8} In Surface{1}; Point{9} In Surface{1};
Physical Curve("left") = {4}; Physical Curve("interface") = {2}; Physical Curve("crack") = {8}; Physical Curve("right") = {6};
)";

TEST(GmshReader, SurfacesThatShareACurveAreOneBody) {
  const std::string path = file("two.geo", std::string(two_squares) + "MeshSize{:} = 0.1;\n");
  for (const double size : {0.1, 0.0}) {
    const FineMesh<2> mesh(read_gmsh<2>(path, {.size = size}));
    expect_consistent(mesh);
    EXPECT_EQ(mesh.num_components(), 1);
    EXPECT_EQ(euler_characteristic(mesh), 1);
    EXPECT_NEAR(mesh.volumes().sum(), 2.0, 1e-12);
    EXPECT_NEAR(length(mesh, "left"), 1.0, 1e-12);
    EXPECT_INPUT_ERROR(mesh.group("interface"), "no part of the boundary is named \"interface\"");
    int embedded = 0;
    for (Index v = 0; v < mesh.num_vertices(); ++v) embedded += (mesh.vertex(v) - Vec<2>(0.2, 0.8)).norm() < 1e-12;
    EXPECT_EQ(embedded, 1);
  }
}

TEST(GmshReader, SurfacesThatLieOnEachOtherAreRefused) {
  const std::string square =
      "Point(1) = {0, 0, 0, 0.2}; Point(2) = {1, 0, 0, 0.2}; Point(3) = {1, 1, 0, 0.2}; Point(4) = {0, 1, 0, 0.2};\n"
      "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};\nCurve Loop(1) = {1, 2, 3, 4};\n";
  const auto second = [](const std::string& low, const std::string& high) {
    return "Point(5) = {" + low + ", 0.4, 0, 0.2}; Point(6) = {" + high + ", 0.4, 0, 0.2};\nPoint(7) = {" + high +
           ", 0.6, 0, 0.2}; Point(8) = {" + low + ", 0.6, 0, 0.2};\nLine(5) = {5, 6}; Line(6) = {6, 7}; " +
           "Line(7) = {7, 8}; Line(8) = {8, 5};\nCurve Loop(2) = {5, 6, 7, 8};\n";
  };
  const auto read = [&](const std::string& text) { return read_gmsh<2>(file("on.geo", text), {.size = 0.2}); };
  for (const auto& [low, high] :
       {std::pair{"0.4", "0.6"}, {"0.8", "1.4"}, {"-0.5", "1.5"}})  // within, half on it, across
    EXPECT_INPUT_ERROR(read(square + second(low, high) + "Plane Surface(1) = {1}; Plane Surface(2) = {2};\n"),
                       "overlap around");
  EXPECT_NEAR(FineMesh<2>(read(square + second("0.4", "0.6") + "Plane Surface(1) = {1, 2}; Plane Surface(2) = {2};\n"))
                  .volumes()
                  .sum(),
              1.0, 1e-12);
}

TEST(GmshReader, CutsOpenAlongEmbeddedAndSharedCurves) {
  const std::string path = file("two.geo", std::string(two_squares) + "MeshSize{:} = 0.1;\n");
  for (const double size : {0.1, 0.0}) {
    const FineMesh<2> cracked(read_gmsh<2>(path, {.size = size, .slits = {"crack"}}));
    expect_consistent(cracked);
    EXPECT_EQ(euler_characteristic(cracked), 0);
    EXPECT_NEAR(length(cracked, "crack"), 2.0 * 0.5, 1e-12);
    const FineMesh<2> parted(read_gmsh<2>(path, {.size = size, .slits = {"interface", "crack"}}));
    expect_consistent(parted);
    EXPECT_EQ(parted.num_components(), 2);
    EXPECT_NEAR(length(parted, "interface"), 2.0, 1e-12);
  }
  EXPECT_INPUT_ERROR(read_gmsh<2>(path, {.size = 0.1, .slits = {"slot"}}),
                     "slit \"slot\" is no physical curve; the file has \"crack\", ");
}

TEST(GmshReader, MeshesPhysicalSurfacesOnly) {
  const std::string path = file("two.geo", std::string(two_squares) + "Physical Surface(\"body\") = {2};\n");
  for (const double size : {0.1, 0.0}) {
    const FineMesh<2> mesh(read_gmsh<2>(path, {.size = size}));
    EXPECT_NEAR(mesh.volumes().sum(), 1.0, 1e-12);
    EXPECT_NEAR(length(mesh, "interface"), 1.0, 1e-12);
    EXPECT_INPUT_ERROR(mesh.group("left"), "the mesh has \"interface\", \"right\"");
  }
}

const char* const square_msh = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 7 "bottom"
1 8 "middle"
2 9 "body"
$EndPhysicalNames
$Nodes
7
1 0 0 2
2 1 0 2
4 1 1 2
5 0 1 2
9 0.5 0.5 2
12 5 5 2
13 6 5 2
$EndNodes
$Elements
8
1 1 2 7 1 1 2
2 1 2 8 2 1 9
3 1 2 8 2 9 4
4 2 2 9 1 1 2 9
5 2 2 9 1 2 4 9
6 2 2 9 1 4 5 9
7 2 2 9 1 9 5 1
8 2 2 0 5 12 13 4
$EndElements
)";

TEST(GmshReader, ReadsMshFiles) {
  const std::string path = file("square.msh", square_msh);
  const FineMesh<2> mesh(read_gmsh<2>(path));
  expect_consistent(mesh);
  EXPECT_EQ(mesh.num_vertices(), 5);  // the triangle that belongs to no physical surface is not read
  EXPECT_EQ(mesh.num_cells(), 4);
  EXPECT_DOUBLE_EQ(mesh.volumes().sum(), 1.0);
  EXPECT_DOUBLE_EQ(length(mesh, "bottom"), 1.0);
  const FineMesh<2> parted(read_gmsh<2>(path, {.slits = {"middle"}}));
  EXPECT_EQ(parted.num_components(), 2);
  EXPECT_DOUBLE_EQ(length(parted, "middle"), 2.0 * std::sqrt(2.0));
}

TEST(GmshReader, LeavesTheNumberOfThreadsAlone) {
  const int before = omp_get_max_threads();
  omp_set_num_threads(2);
  read_gmsh<2>(file("plate.geo", plate_script), {.size = 0.5});
  EXPECT_EQ(omp_get_max_threads(), 2);
  omp_set_num_threads(before);
}

TEST(GmshReader, RefusesWrongInputInGmshsWords) {
  EXPECT_INPUT_ERROR(read_gmsh<2>("nowhere/plate.geo"), "nowhere/plate.geo: cannot read the file");
  EXPECT_INPUT_ERROR(read_gmsh<2>("plate.stl"), "expected a .geo or .msh file");
  const std::string good = file("plate.geo", plate_script);
  EXPECT_INPUT_ERROR(read_gmsh<2>(good, {.size = -1.0}), "size is -1");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("typo.geo", "Point(1) = {0, 0, zero};\n"), {.size = 0.1}),
                     "line 1: Unknown variable 'zero'");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("empty.geo", "Point(1) = {0, 0, 0};\n"), {.size = 0.1}),
                     "there is no surface in it");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("empty2.geo", "Point(1) = {0, 0, 0};\n")), "there are no triangles in it");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("cut.geo", "Point(1) = {0, 0, 0};")), "its last line has no end");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("nothing.geo", "")), "the file is empty or");
  const std::string sphere = file("sphere.geo", "SetFactory(\"OpenCASCADE\"); Sphere(1) = {0, 0, 0, 1};\n");
  EXPECT_INPUT_ERROR(read_gmsh<2>(sphere, {.size = 0.3}), "of type \"Sphere\", expected a plane surface");
  EXPECT_INPUT_ERROR(read_gmsh<2>(sphere), "not in one plane z = const");
  const std::string tilted = file(
      "tilted.geo",
      "SetFactory(\"OpenCASCADE\"); Rectangle(1) = {0, 0, 0, 1, 1}; Rotate{{1, 0, 0}, {0, 0, 0}, 1}{ Surface{1}; }\n");
  EXPECT_INPUT_ERROR(read_gmsh<2>(tilted, {.size = 0.3}), "not in one plane z = const");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("quads.geo", std::string(plate_script) + "Recombine Surface{1};\n")),
                     "expected triangles only");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("junk.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 2 3\nxx\n")),
                     "junk.msh: Could not read nodes");
  const std::string msh = file("square.msh", square_msh);
  EXPECT_INPUT_ERROR(read_gmsh<2>(msh, {.size = 0.1}), "a size (0.1) applies to geometry only");
  EXPECT_INPUT_ERROR(read_gmsh<2>(msh, {.parameters = {{"radius", 1.0}}}), "only .geo files have parameters");
  // Errors leave nothing behind.
  expect_plate(FineMesh<2>(read_gmsh<2>(good, {.size = 0.3})), 1.0, 4.0, 0.3);
}

}  // namespace
}  // namespace efree
