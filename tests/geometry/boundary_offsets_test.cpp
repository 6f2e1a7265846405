// SPDX-License-Identifier: GPL-3.0-or-later
/// Where the true surface lies beside facets: what facets and offsets enclose is the true area or volume.
#include "efree/geometry/mesh/boundary_offsets.hpp"

#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

namespace efree {
namespace {

constexpr double pi = std::numbers::pi;

/// Area or volume between facets and surface.
template <int Dim> double enclosed(const FineMesh<Dim>& mesh, const Matrix& vectors) {
  const Matrix offsets = normal_offsets(mesh, vectors);
  double sum = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f)
    sum += mesh.facet_measure(f) * (Dim == 2 ? (offsets(0, f) + offsets(1, f) + 4.0 * offsets(2, f)) / 6.0
                                             : offsets.col(f).tail(3).sum() / 3.0);
  return sum;
}

/// The volume that the facets are off, and what of it the offsets leave.
template <int Dim> void expect_true_volume(const CurvedMesh<Dim>& curved, double volume, double left) {
  const FineMesh<Dim> mesh(curved.mesh);
  const double off = volume - mesh.volumes().sum();
  EXPECT_GT(std::abs(off), 1e-4 * volume);
  EXPECT_NEAR(enclosed(mesh, facet_offsets(mesh, curved.boundary)), off, left * std::abs(off));
}

std::string written(const std::string& name, const std::string& text) {
  const auto path = std::filesystem::temp_directory_path() / ("efree_boundary_offsets_" + name);
  std::ofstream(path) << text;
  return path.string();
}

TEST(BoundaryOffsets, OfCirclesInThePlane) {
  const double area = pi * (4.0 - 1.0);
  const CurvedMesh<2> whole = triangulate_curved(shapes::annulus(1.0, 2.0, 0.5), {.size = 0.5});
  expect_true_volume(whole, area, 0.02);
  // Chords that are split stay where they are.
  expect_true_volume(triangulate_curved(shapes::annulus(1.0, 2.0, 0.5), {.size = 0.1}), area, 0.02);
  const FineMesh<2> mesh(whole.mesh);
  const Matrix offsets = normal_offsets(mesh, facet_offsets(mesh, whole.boundary));
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    const bool inner = mesh.vertex(mesh.facets()(0, f)).norm() < 1.5;
    EXPECT_LT(inner ? offsets(2, f) : -offsets(2, f), 0.0);
  }
}

TEST(BoundaryOffsets, OfAnEllipseOfGmshByBothMeshers) {
  const std::string ellipse = written("ellipse.geo",
                                      "SetFactory(\"OpenCASCADE\");\nEllipse(1) = {0, 0, 0, 2, 1};\n"
                                      "Curve Loop(1) = {1};\nPlane Surface(1) = {1};\nMeshSize{:} = 0.5;\n");
  for (const double size : {0.0, 0.5}) expect_true_volume(read_curved_gmsh<2>(ellipse, {.size = size}), 2.0 * pi, 0.05);
}

TEST(BoundaryOffsets, OfSolidsWhateverTheirSurfaces) {
  expect_true_volume(solids::thick_sphere(1.0, 2.0, 0.5), pi / 6.0 * (8.0 - 1.0), 0.06);
  expect_true_volume(solids::cylinder(1.0, 1.0, 0.4), pi, 0.06);
  expect_true_volume(solids::half_torus(2.0, 0.5, 0.3), pi * pi * 2.0 * 0.25, 0.06);
}

/// The rim of a cylinder that is cut at 45 degrees is no part of either surface's facets.
TEST(BoundaryOffsets, OfEdgesBetweenSurfacesAgreeWithBoth) {
  const std::string cut = written("cut.geo",
                                  "SetFactory(\"OpenCASCADE\");\nCylinder(1) = {0, 0, 0, 0, 0, 4, 1};\n"
                                  "Box(2) = {-3, -3, 2, 6, 6, 6};\nRotate{{0, 1, 0}, {0, 0, 2}, Pi / 4}{ Volume{2}; }\n"
                                  "BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };\n");
  expect_true_volume(read_curved_gmsh<3>(cut, {.size = 0.5}), 2.0 * pi, 0.08);
}

TEST(BoundaryOffsets, FollowEdgesThatAreSplit) {
  const CurvedMesh<3> coarse = solids::cylinder(1.0, 1.0, 0.4);
  expect_true_volume(split_long_edges<3>(coarse, 0.15), pi, 0.06);
}

TEST(BoundaryOffsets, AreGuessedFromFacetsWhereNothingIsKnown) {
  const std::string ellipse = written("guess.geo",
                                      "SetFactory(\"OpenCASCADE\");\nEllipse(1) = {0, 0, 0, 2, 1};\n"
                                      "Curve Loop(1) = {1};\nPlane Surface(1) = {1};\nMeshSize{:} = 0.4;\n");
  const FineMesh<2> mesh(read_gmsh<2>(ellipse));
  const double off = 2.0 * pi - mesh.volumes().sum();
  EXPECT_NEAR(enclosed(mesh, facet_offsets(mesh, smooth_offsets(mesh))), off, 0.2 * std::abs(off));
  const FineMesh<3> sphere(solids::thick_sphere(1.0, 2.0, 0.4));
  const double missing = 7.0 * pi / 6.0 - sphere.volumes().sum();
  EXPECT_NEAR(enclosed(sphere, facet_offsets(sphere, smooth_offsets(sphere))), missing, 0.3 * std::abs(missing));
  const FineMesh<3> box(solids::box({1.0, 1.0, 1.0}, 0.4));
  EXPECT_EQ(smooth_offsets(box).points.cols(), 0);
}

/// Sagittas over the thickness of the wall.
template <int Dim> double worst(const CurvedMesh<Dim>& curved) {
  const FineMesh<Dim> mesh(curved.mesh);
  const Vector heights = sagittas(mesh, facet_offsets(mesh, curved.boundary)), thickness = wall_thickness(mesh);
  return (heights.array() / thickness.array()).maxCoeff();
}

TEST(Sagittas, AreAShareOfTheWallWhereItIsAskedFor) {
  EXPECT_GT(worst(triangulate_curved(shapes::annulus(9.8, 10.0, 3.0), {.size = 3.0})), 0.3);
  EXPECT_LT(worst(triangulate_curved(shapes::annulus(9.8, 10.0, 3.0, 0.05), {.size = 3.0})), 0.055);
  const std::string tube = written("tube.geo",
                                   "SetFactory(\"OpenCASCADE\");\nDisk(1) = {0, 0, 0, 10};\nDisk(2) = {0, 0, 0, 9.5};\n"
                                   "BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };\n"
                                   "MeshSize{:} = 3;\n");
  for (const double size : {0.0, 3.0}) {
    EXPECT_GT(worst(read_curved_gmsh<2>(tube, {.size = size})), 0.1);
    EXPECT_LT(worst(read_curved_gmsh<2>(tube, {.size = size, .sagitta = 0.05})), 0.08);
  }
  EXPECT_GT(worst(solids::thick_cylinder(9.5, 10.0, 8.0, 5.0)), 0.1);
  EXPECT_LT(worst(solids::thick_cylinder(9.5, 10.0, 8.0, 5.0, 0.0, 0.05)), 0.08);
}

/// With 16 chords to a turn those of the outer circle cut the inner one.
TEST(Sagittas, AreFineEnoughWhereCoarseFacetsOfTwoSidesCross) {
  const std::string thin =
      written("thin.geo",
              "SetFactory(\"OpenCASCADE\");\nDisk(1) = {0, 0, 0, 10};\nDisk(2) = {0, 0, 0, 9.95};\n"
              "BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };\n");
  EXPECT_LT(worst(read_curved_gmsh<2>(thin, {.size = 3.0, .sagitta = 0.05})), 0.08);
}

}  // namespace
}  // namespace efree
