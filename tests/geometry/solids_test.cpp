// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "files.hpp"
#include "meshes.hpp"

#include <map>
#include <numbers>

namespace efree {
namespace {

using std::numbers::pi;
using test::file;

double area(const FineMesh<3>& mesh, const std::string& group) {
  double sum = 0.0;
  for (const Index f : mesh.group(group)) sum += mesh.facet_measure(f);
  return sum;
}

/// What must hold on any mesh of a solid whose groups cover its boundary once.
void expect_solid(const FineMesh<3>& mesh, double size) {
  std::vector<int> count(mesh.num_facets(), 0);
  for (const auto& group : mesh.groups())
    for (const Index f : group.facets) ++count[f];
  EXPECT_EQ(std::ranges::count(count, 1), mesh.num_facets());
  EXPECT_LE(mesh.size(), size * (1.0 + 1e-12));
  EXPECT_GE(mesh.size(), 0.7 * size);
  // A closed surface: the area vectors cancel, and the flux of x/3 is the volume.
  Vec<3> sum = Vec<3>::Zero();
  double flux = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const Vec<3> a = mesh.facet_measure(f) * mesh.facet_normal(f);
    sum += a;
    flux += a.dot(mesh.vertex(mesh.facets()(0, f))) / 3.0;
  }
  EXPECT_LT(sum.norm(), 1e-11);
  EXPECT_NEAR(flux, mesh.volumes().sum(), 1e-11);
}

TEST(Solids, BoxHasItsSidesAndVolume) {
  const FineMesh<3> mesh(solids::box({1.0, 2.0, 0.5}, 0.25));
  expect_solid(mesh, 0.25);
  EXPECT_NEAR(mesh.volumes().sum(), 1.0, 1e-12);
  EXPECT_EQ(mesh.groups().size(), 6u);
  for (const auto& [name, expected, normal] :
       std::vector<std::tuple<std::string, double, Vec<3>>>{{"left", 1.0, {-1, 0, 0}},
                                                            {"right", 1.0, {1, 0, 0}},
                                                            {"front", 0.5, {0, -1, 0}},
                                                            {"back", 0.5, {0, 1, 0}},
                                                            {"bottom", 2.0, {0, 0, -1}},
                                                            {"top", 2.0, {0, 0, 1}}}) {
    EXPECT_NEAR(area(mesh, name), expected, 1e-12) << name;
    for (const Index f : mesh.group(name)) EXPECT_LT((mesh.facet_normal(f) - normal).norm(), 1e-12) << name;
  }
}

TEST(Solids, SphericalCavityIsAnEighthOfACubeWithItsSymmetryPlanes) {
  const double L = 3.0;
  const FineMesh<3> mesh(solids::spherical_cavity(1.0, L, 0.6));
  expect_solid(mesh, 0.6);
  EXPECT_EQ(mesh.groups().size(), 7u);
  for (const char* name : {"left", "front", "bottom"})
    EXPECT_NEAR(area(mesh, name), L * L - pi / 4.0, 0.0201) << name;  // 16-gon
  for (const char* name : {"right", "back", "top"}) EXPECT_NEAR(area(mesh, name), L * L, 1e-11) << name;
  EXPECT_NEAR(area(mesh, "cavity"), 0.5 * pi, 0.03 * 0.5 * pi);
  // Chords of 16 to a turn cut off up to 4 % of a ball.
  const double volume = L * L * L - pi / 6.0;
  EXPECT_GT(mesh.volumes().sum(), volume);
  EXPECT_LT(mesh.volumes().sum(), volume + 0.06 * pi / 6.0);
}

TEST(Solids, CavityIsFinerWhereAsked) {
  const FineMesh<3> mesh(solids::spherical_cavity(1.0, 3.0, 0.8, 0.15));
  expect_solid(mesh, 0.8);
  EXPECT_NEAR(area(mesh, "cavity"), 0.5 * pi, 0.005 * 0.5 * pi);
  const auto mean_area = [&](const std::string& name) { return area(mesh, name) / mesh.group(name).size(); };
  EXPECT_LT(mean_area("cavity"), 0.5 * 0.15 * 0.15);
  EXPECT_GT(mean_area("right"), 0.1 * 0.8 * 0.8);
}

TEST(Solids, TubeAndShellsHaveTheirAreas) {
  const FineMesh<3> tube(solids::thick_cylinder(1.0, 2.0, 0.5, 0.25));
  expect_solid(tube, 0.25);
  EXPECT_NEAR(tube.volumes().sum(), 0.25 * pi * 3.0 * 0.5, 0.01);
  EXPECT_NEAR(area(tube, "inner"), 0.25 * pi, 0.005);
  EXPECT_NEAR(area(tube, "outer"), 0.5 * pi, 0.005);
  for (const char* name : {"left", "front"}) EXPECT_NEAR(area(tube, name), 0.5, 1e-12) << name;
  for (const char* name : {"bottom", "top"}) EXPECT_NEAR(area(tube, name), 0.75 * pi, 0.02) << name;

  const FineMesh<3> shell(solids::thick_sphere(1.0, 2.0, 0.4));
  expect_solid(shell, 0.4);
  EXPECT_EQ(shell.groups().size(), 5u);
  EXPECT_NEAR(shell.volumes().sum(), pi / 6.0 * 7.0, 0.07);
  EXPECT_NEAR(area(shell, "inner"), 0.5 * pi, 0.03);
  EXPECT_NEAR(area(shell, "outer"), 2.0 * pi, 0.05);
  for (const char* name : {"left", "front", "bottom"}) EXPECT_NEAR(area(shell, name), 0.75 * pi, 0.02) << name;

  const FineMesh<3> rod(solids::cylinder(0.5, 2.0, 0.3));
  expect_solid(rod, 0.3);
  EXPECT_NEAR(rod.volumes().sum(), 0.5 * pi, 0.04 * 0.5 * pi);
  EXPECT_NEAR(area(rod, "side"), 2.0 * pi, 0.02 * 2.0 * pi);
}

TEST(Solids, WallsAreMeshedFinerAtTheInside) {
  const auto expect_finer = [](const FineMesh<3>& mesh) {
    const auto mean_area = [&](const std::string& name) { return area(mesh, name) / mesh.group(name).size(); };
    EXPECT_LT(mean_area("inner"), 0.5 * 0.1 * 0.1);
    EXPECT_GT(mean_area("inner"), 0.1 * 0.1 * 0.1);
    EXPECT_GT(mean_area("outer"), 0.15 * 0.4 * 0.4);
  };
  const FineMesh<3> tube(solids::thick_cylinder(1.0, 2.0, 0.8, 0.4, 0.1));
  expect_solid(tube, 0.4);
  expect_finer(tube);
  EXPECT_NEAR(area(tube, "inner"), 0.5 * pi * 0.8, 0.002);
  const FineMesh<3> shell(solids::thick_sphere(1.0, 2.0, 0.4, 0.1));
  expect_solid(shell, 0.4);
  expect_finer(shell);
  EXPECT_NEAR(area(shell, "inner"), 0.5 * pi, 0.003);
}

TEST(Solids, SameInputGivesTheSameMeshBitForBit) {
  const MeshData<3> first = solids::spherical_cavity(1.0, 2.0, 0.4, 0.2);
  const std::vector<double> stir(100000, 1.0);  // moves what is allocated next
  const MeshData<3> second = solids::spherical_cavity(1.0, 2.0, 0.4, 0.2);
  EXPECT_EQ(first.vertices, second.vertices);
  EXPECT_EQ(first.cells, second.cells);
  ASSERT_EQ(first.groups.size(), second.groups.size());
  for (std::size_t g = 0; g < first.groups.size(); ++g) EXPECT_EQ(first.groups[g].facets, second.groups[g].facets);
}

TEST(Solids, RefuseLengthsThatMakeNoShape) {
  EXPECT_INPUT_ERROR(solids::box({1.0, -2.0, 1.0}, 0.1), "box: lengths 1, -2, 1, expected positive ones");
  EXPECT_INPUT_ERROR(solids::box({1.0, 2.0, 1.0}, 0.0), "box of 1 x 2 x 1: size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(solids::box({1.0, 2.0, 1.0}, 1e-5),
                     "box of 1 x 2 x 1: mesh size 1e-05 is too small for a body 2 wide");
  EXPECT_INPUT_ERROR(solids::box(Vec<3>::Constant(1e-30), 1e-30), "box of 1e-30 x 1e-30 x 1e-30: ");
  EXPECT_INPUT_ERROR(solids::spherical_cavity(2.0, 1.0, 0.1), "expected 0 < radius < half width");
  EXPECT_INPUT_ERROR(solids::thick_cylinder(2.0, 1.0, 1.0, 0.1), "expected 0 < inner < outer");
  EXPECT_INPUT_ERROR(solids::thick_sphere(2.0, 1.0, 0.1), "expected 0 < inner < outer");
  EXPECT_INPUT_ERROR(solids::thick_cylinder(1.0, 2.0, 1.0, 0.1, -1.0),
                     "thick cylinder: the size at the inner wall is -1, expected a positive length or 0");
  EXPECT_INPUT_ERROR(solids::thick_sphere(1.0, 2.0, 0.1, std::nan("")),
                     "thick sphere: the size at the inner wall is nan");
  EXPECT_INPUT_ERROR(solids::thick_sphere(1.0, 2.0, 0.2, 1e-6), "a mesh of size 1e-06 at a wall");
  EXPECT_INPUT_ERROR(solids::spherical_cavity(1.0, 2.0, 0.2, 1e-6), "a mesh of size 1e-06 at a wall");
  EXPECT_INPUT_ERROR(solids::cylinder(1.0, 0.0, 0.1), "expected positive ones");
}

double volume(const FineMesh<3>& mesh, const std::string& region) {
  double sum = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (mesh.region(c) == mesh.region(region)) sum += mesh.volume(c);
  return sum;
}

const char* const two_boxes = R"(SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {1, 0.25, 0.25, 1, 0.5, 0.5};
)";
const char* const joined = R"(BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }
)";

TEST(GmshSolid, PhysicalVolumesAreRegionsAndMeetInTheirFacets) {
  const std::string path = file("two.geo", std::string(two_boxes) + joined + R"(
Physical Volume("cube") = {1}; Physical Volume("arm") = {2};
Physical Surface("base") = Surface In BoundingBox{-0.1, -0.1, -0.1, 0.1, 1.1, 1.1};
Physical Surface("joint") = Surface In BoundingBox{0.9, 0.2, 0.2, 1.1, 0.8, 0.8};
)");
  EXPECT_EQ(gmsh_dimension(path), 3);
  const MeshData<3> data = read_gmsh<3>(path, {.size = 0.3});
  const FineMesh<3> mesh(data);
  EXPECT_LE(mesh.size(), 0.3);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"arm", "cube"}));
  EXPECT_NEAR(volume(mesh, "cube"), 1.0, 1e-12);
  EXPECT_NEAR(volume(mesh, "arm"), 0.25, 1e-12);
  EXPECT_NEAR(area(mesh, "base"), 1.0, 1e-12);
  const FineMesh<3> parted(cut_regions<3>(data));
  EXPECT_EQ(parted.num_components(), 2);
  double between = 0.0;
  for (const auto& [a, b] : tied_facets<3>(parted)) between += parted.facet_measure(a);
  EXPECT_NEAR(between, 0.25, 1e-12);
  EXPECT_NEAR(area(parted, "joint"), 0.5, 1e-12);
  const FineMesh<3> slit(read_gmsh<3>(path, {.size = 0.3, .slits = {"joint"}}));
  EXPECT_EQ(slit.num_components(), 2);
  EXPECT_NEAR(area(slit, "joint"), 0.5, 1e-12);
  EXPECT_INPUT_ERROR(read_gmsh<3>(path, {.size = 0.3, .slits = {"crack"}}), "slit \"crack\" is no physical surface");
}

TEST(GmshSolid, WithoutPhysicalGroupsVolumesAndSurfacesGoByTheirNumbers) {
  const FineMesh<3> mesh(read_gmsh<3>(file("two.geo", std::string(two_boxes) + joined), {.size = 0.4}));
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"volume 1", "volume 2"}));
  double sum = 0.0, boundary = 0.0;
  for (const auto& group : mesh.groups()) sum += area(mesh, group.name);
  for (Index f = 0; f < mesh.num_facets(); ++f) boundary += mesh.facet_measure(f);
  EXPECT_NEAR(sum, boundary, 1e-11);
  EXPECT_NEAR(sum, 6.0 + 4.0 * 0.5, 1e-11);
}

TEST(GmshSolid, CutsOpenAlongACrackInside) {
  const std::string path = file("crack.geo", R"(SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1}; Disk(20) = {0.5, 0.5, 0.5, 0.3};
BooleanFragments{ Volume{1}; Delete; }{ Surface{20}; Delete; }
Physical Volume("body") = {1};
Physical Surface("crack") = Surface In BoundingBox{0.1, 0.1, 0.4, 0.9, 0.9, 0.6};
)");
  const FineMesh<3> mesh(read_gmsh<3>(path, {.size = 0.2, .slits = {"crack"}}));
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_NEAR(mesh.volumes().sum(), 1.0, 1e-12);
  EXPECT_NEAR(area(mesh, "crack"), 2.0 * pi * 0.09, 0.03 * 2.0 * pi * 0.09);
  Index up = 0;
  for (const Index f : mesh.group("crack")) up += mesh.facet_normal(f).z() > 0.0;
  EXPECT_EQ(2 * up, static_cast<Index>(mesh.group("crack").size()));
}

TEST(GmshSolid, StepBodiesThatTouchShareTheirFacetsInTheUnitOfTheFile) {
  const std::string step = file("two.step", "");
  read_gmsh<3>(file("write.geo", std::string(two_boxes) + "Save \"" + step + "\";\n"), {.size = 1.0, .trust = true});
  const MeshData<3> data = read_gmsh<3>(step, {.size = 0.3});
  const FineMesh<3> mesh(data);
  EXPECT_EQ(mesh.num_regions(), 2);
  EXPECT_EQ(mesh.num_components(), 1);
  EXPECT_NEAR(mesh.volumes().sum(), 1.25, 1e-9);
  double between = 0.0;
  const FineMesh<3> parted(cut_regions<3>(data));
  for (const auto& [a, b] : tied_facets<3>(parted)) between += parted.facet_measure(a);
  EXPECT_NEAR(between, 0.25, 1e-9);

  // The same numbers in metres.
  std::ifstream in(step);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  int units = 0;
  for (std::size_t at = text.find(".MILLI."); at != std::string::npos; at = text.find(".MILLI."), ++units)
    text.replace(at, 7, "$");
  ASSERT_GT(units, 0);
  const FineMesh<3> metres(read_gmsh<3>(file("metre.stp", text), {.size = 0.3}));
  EXPECT_NEAR(metres.volumes().sum(), 1.25, 1e-9);
  EXPECT_LE(metres.size(), 0.3 * (1.0 + 1e-12));
  // In centimetres, as a multiple of another unit under whatever name.
  for (const char* name : {"CENTIMETRE", "cm"}) {
    std::string centi = text;
    for (std::size_t at = 0;
         (at = centi.find("LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.)", at)) != std::string::npos;) {
      const std::string unit = "CONVERSION_BASED_UNIT('" + std::string(name) + "',#9001)LENGTH_UNIT()NAMED_UNIT(#9003)";
      centi.replace(at, 44, unit);
      at += unit.size();
    }
    const std::size_t end = centi.rfind("ENDSEC;");
    centi.insert(end,
                 "#9001=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(10.),#9002);\n"
                 "#9002=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n"
                 "#9003=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n");
    const FineMesh<3> converted(read_gmsh<3>(file("centimetre.stp", centi), {.size = 0.3}));
    EXPECT_NEAR(converted.volumes().sum(), 1.25, 1e-9) << name;
  }
  EXPECT_INPUT_ERROR(read_gmsh<3>(file("half.step", text.substr(0, text.size() / 2)), {.size = 0.3}),
                     "half.step: Could not read file");
}

TEST(GmshSolid, WhatTwoBodiesShareIsARegionOfItsOwn) {
  const std::string brep = file("overlap.brep", "");
  read_gmsh<3>(file("write.geo",
                    "SetFactory(\"OpenCASCADE\"); Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {0.75, 0, 0, 1, 1, "
                    "1};\nSave \"" +
                        brep + "\";\n"),
               {.size = 1.0, .trust = true});
  const FineMesh<3> mesh(read_gmsh<3>(brep, {.size = 0.5}));
  EXPECT_EQ(mesh.region_names(), (std::vector<std::string>{"body 1", "body 1 & body 2", "body 2"}));
  EXPECT_NEAR(volume(mesh, "body 1 & body 2"), 0.25, 1e-9);
  EXPECT_NEAR(mesh.volumes().sum(), 1.75, 1e-9);
}

TEST(GmshSolid, RefusesWrongInput) {
  const std::string flat = file("flat.geo", "SetFactory(\"OpenCASCADE\"); Rectangle(1) = {0, 0, 0, 1, 1};\n");
  EXPECT_EQ(gmsh_dimension(flat), 2);
  EXPECT_INPUT_ERROR(read_gmsh<3>(flat, {.size = 0.3}), "there is no volume in it");
  EXPECT_INPUT_ERROR(read_gmsh<3>(file("letter.step", "Dear reader\n"), {.size = 0.3}), "Could not read file");
  EXPECT_INPUT_ERROR(read_gmsh<3>(file("letter.brep", "Dear reader\n"), {.size = 0.3}), "letter.brep: ");
  EXPECT_INPUT_ERROR(read_gmsh<3>(file("empty.step", ""), {.size = 0.3}), "the file is empty");
  EXPECT_INPUT_ERROR(read_gmsh<2>(file("letter.step", "Dear reader\n"), {.size = 0.3}), "a CAD file holds solids");
  EXPECT_INPUT_ERROR(gmsh_dimension("nowhere/a.step"), "nowhere/a.step: cannot read the file");
  const std::string twice = file("twice.geo",
                                 "SetFactory(\"OpenCASCADE\"); Box(1) = {0, 0, 0, 1, 1, 1};\n"
                                 "Physical Volume(\"a\") = {1}; Physical Volume(\"b\") = {1};\n");
  EXPECT_INPUT_ERROR(read_gmsh<3>(twice, {.size = 0.3}), "volume 1 belongs to the physical groups \"a\" and \"b\"");
  const std::string msh =
      file("hex.msh",
           "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n"
           "5 0 0 1\n6 1 0 1\n7 1 1 1\n8 0 1 1\n$EndNodes\n$Elements\n1\n1 5 2 0 1 1 2 3 4 5 6 7 8\n"
           "$EndElements\n");
  EXPECT_EQ(gmsh_dimension(msh), 3);
  EXPECT_INPUT_ERROR(read_gmsh<3>(msh), "has elements \"Hexahedron 8\", expected tetrahedra only; mesh it with tetra");
}

TEST(GmshSolid, SecondOrderTetrahedraAreReadByTheirCornerNodes) {
  const std::string geo =
      "SetFactory(\"OpenCASCADE\"); Box(1) = {0, 0, 0, 2, 1, 1}; Physical Volume(\"bar\") = {1};\n"
      "Physical Surface(\"end\") = {1}; Mesh.MeshSizeMax = 0.5;\n";
  const std::string first = file("first.msh", ""), second = file("second.msh", "");
  read_gmsh<3>(file("first.geo", geo + "Mesh 3; Save \"" + first + "\";\n"), {.size = 1.0, .trust = true});
  read_gmsh<3>(file("second.geo", geo + "Mesh 3; SetOrder 2; Save \"" + second + "\";\n"),
               {.size = 1.0, .trust = true});
  const CurvedMesh<3> first_order = read_curved_gmsh<3>(first), second_order = read_curved_gmsh<3>(second);
  EXPECT_EQ(first_order.order, 1);
  EXPECT_EQ(second_order.order, 2);
  const FineMesh<3> linear(first_order.mesh), corners(second_order.mesh);
  EXPECT_EQ(corners.num_cells(), linear.num_cells());
  EXPECT_EQ(corners.num_vertices(), linear.num_vertices());
  EXPECT_NEAR(corners.volumes().sum(), 2.0, 1e-9);
  EXPECT_EQ(corners.group("end").size(), linear.group("end").size());
}

TEST(GmshPlane, PhysicalSurfacesAreRegionsWithAndWithoutASize) {
  const std::string path = file("two.geo", R"(
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {1, 1, 0}; Point(4) = {0, 1, 0}; Point(5) = {3, 0, 0}; Point(6) = {3, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(5) = {2, 5}; Line(6) = {5, 6}; Line(7) = {6, 3};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1}; Curve Loop(2) = {5, 6, 7, -2}; Plane Surface(2) = {2};
Physical Surface("soft") = {1}; Physical Surface("hard") = {2}; Physical Curve("seam") = {2};
MeshSize{:} = 0.2;
)");
  for (const double size : {0.2, 0.0}) {
    const MeshData<2> data = read_gmsh<2>(path, {.size = size});
    const FineMesh<2> mesh(data);
    ASSERT_EQ(mesh.region_names(), (std::vector<std::string>{"hard", "soft"}));
    double hard = 0.0, seam = 0.0;
    for (Index c = 0; c < mesh.num_cells(); ++c) {
      EXPECT_EQ(mesh.region(c), mesh.centroid(c).x() > 1.0 ? 0 : 1);
      if (mesh.region(c) == 0) hard += mesh.volume(c);
    }
    EXPECT_NEAR(hard, 2.0, 1e-12);
    const FineMesh<2> parted(cut_regions<2>(data));
    EXPECT_EQ(parted.num_components(), 2);
    for (const auto& [a, b] : tied_facets<2>(parted)) seam += parted.facet_measure(a);
    EXPECT_NEAR(seam, 1.0, 1e-12);
    EXPECT_NEAR(test::length(parted, "seam"), 2.0, 1e-12);
  }
}

TEST(Solids, TooSlenderForFacetsAroundThemAreRefusedBeforeTheyAreMeshed) {
  EXPECT_INPUT_ERROR(solids::cylinder(1e-3, 5000.0, 250.0), "it is too slender for 16 edges to a turn");
  EXPECT_INPUT_ERROR(solids::thick_cylinder(1e-3, 1.0, 2e4, 250.0), "it is too slender");
  EXPECT_INPUT_ERROR(solids::half_torus(5000.0, 1e-3, 250.0), "it is too slender");
}

TEST(Refine, SplitsLongEdgesAndKeepsVolumeGroupsAndRegions) {
  MeshData<3> mesh;
  mesh.vertices.resize(3, 5);
  mesh.vertices << 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 0, 1, 1;
  mesh.cells.resize(4, 2);
  mesh.cells << 0, 1, 1, 2, 2, 3, 3, 4;
  mesh.groups = {{"base", {{0, 1, 2}}}, {"between", {{3, 2, 1}}}};
  mesh.regions = {0, 1};
  mesh.region_names = {"low", "high"};
  const MeshData<3> split = split_long_edges<3>(mesh, 0.3);
  const FineMesh<3> fine(split);
  EXPECT_LE(fine.size(), 0.3);
  EXPECT_GE(fine.size(), 0.15);
  EXPECT_NEAR(area(fine, "base"), 0.5, 1e-14);
  double low = 0.0, between = 0.0;
  for (Index c = 0; c < fine.num_cells(); ++c) low += fine.region(c) == 0 ? fine.volume(c) : 0.0;
  EXPECT_NEAR(low, 1.0 / 6.0, 1e-14);
  EXPECT_NEAR(fine.volumes().sum(), 0.5, 1e-14);
  const FineMesh<3> parted(cut_regions<3>(split));
  for (const auto& [a, b] : tied_facets<3>(parted)) between += parted.facet_measure(a);
  EXPECT_NEAR(between, 0.5 * std::sqrt(3.0), 1e-13);
  EXPECT_EQ(split.groups[1].facets.size(), tied_facets<3>(parted).size());
  EXPECT_INPUT_ERROR(split_long_edges<3>(mesh, 0.0), "the longest edge is 0, expected a positive length");
}

}  // namespace
}  // namespace efree
