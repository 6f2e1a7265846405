// SPDX-License-Identifier: GPL-3.0-or-later
/// Where the true surface lies beside facets: what facets and offsets enclose is the true area or volume.
#include "efree/geometry/mesh/boundary_offsets.hpp"

#include "efree/geometry/input/surface_offsets.hpp"
#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/mesh/walls.hpp"
#include "efree/geometry/meshing/gmsh_reader.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/tests/geometry/surfaces.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

namespace efree {
namespace {

using std::numbers::pi;

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

TEST(BoundaryOffsets, FollowAMeshInAnotherUnitOfLength) {
  for (const double factor : {1e-3, 25.4, 1.0 / 3.0}) {
    const auto expect_scaled = [&](const auto& curved, auto dimension) {
      constexpr int Dim = decltype(dimension)::value;
      const FineMesh<Dim> mesh(curved.mesh);
      const auto other = scaled<Dim>(curved, factor);
      const Matrix before = facet_offsets(mesh, curved.boundary),
                   after = facet_offsets(FineMesh<Dim>(other.mesh), other.boundary);
      ASSERT_EQ(after.cols(), before.cols());
      EXPECT_GT(before.cwiseAbs().maxCoeff(), 0.0);
      EXPECT_LT((after - factor * before).cwiseAbs().maxCoeff(), 1e-15 * factor);
    };
    expect_scaled(solids::cylinder(1.0, 1.0, 0.4), std::integral_constant<int, 3>());
    expect_scaled(triangulate_curved(shapes::annulus(1.0, 2.0, 0.3), {.size = 0.3}), std::integral_constant<int, 2>());
  }
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

CurvedMesh<3> meshed(const SurfaceSoup& surface, double size) {
  MeshData<3> data = mesh_surface(surface, {.size = size});
  auto offsets = surface_offsets(FineMesh<3>(data), surface, largest_smooth_angle, 0.1 * size);
  return {.mesh = std::move(data), .boundary = std::move(offsets)};
}

/// What facets of the mesh leave of the triangles, and triangles of the sphere.
TEST(SurfaceOffsets, LeadFromTrianglesToTheSphereHoweverFineTheMesh) {
  for (const int rings : {8, 16})
    for (const double size : {0.8, 0.4})
      expect_true_volume(meshed(test::sphere_surface({0.0, 0.0, 0.0}, 1.0, rings), size), 4.0 / 3.0 * pi, 0.15);
}

TEST(SurfaceOffsets, OfATubeAreRadialAtItsRimsToo) {
  const CurvedMesh<3> tube = meshed(test::revolved_surface({{1, 0}, {2, 0}, {2, 1}, {1, 1}}, 16), 0.5);
  expect_true_volume(tube, pi * (4.0 - 1.0), 0.15);
  for (Index k = 0; k < tube.boundary.points.cols(); ++k)
    EXPECT_NEAR(tube.boundary.offsets(2, k), 0.0, 1e-3 * tube.boundary.offsets.col(k).norm());
}

/// A profile along z.
SurfaceSoup extruded(const std::vector<Vec<2>>& profile, const Vec<2>& middle, double height) {
  const auto n = static_cast<Index>(profile.size());
  SurfaceSoup soup;
  soup.points.resize(3, 2 * n + 2);
  soup.points.col(2 * n) << middle, 0.0;
  soup.points.col(2 * n + 1) << middle, height;
  for (Index k = 0; k < n; ++k) {
    soup.points.col(k) << profile[k], 0.0;
    soup.points.col(n + k) << profile[k], height;
    const Index next = (k + 1) % n;
    soup.triangles.push_back({k, next, n + next});
    soup.triangles.push_back({k, n + next, n + k});
    soup.triangles.push_back({next, k, 2 * n});
    soup.triangles.push_back({n + k, n + next, 2 * n + 1});
  }
  return soup;
}

TEST(SurfaceOffsets, AreNoneOfBodiesOfPlanes) {
  EXPECT_EQ(meshed(test::box_surface({0, 0, 0}, {1, 2, 3}), 0.5).boundary.points.cols(), 0);
  // A bracket with a chamfer of 45 degrees.
  const SurfaceSoup bracket = extruded({{0, 0}, {4, 0}, {4, 1}, {1.5, 1}, {1, 1.5}, {1, 4}, {0, 4}}, {0.5, 0.5}, 1.0);
  EXPECT_EQ(meshed(bracket, 0.5).boundary.points.cols(), 0);
  // Sides that meet at 30 degrees, where it is said that they do.
  std::vector<Vec<2>> sides;
  for (int k = 0; k < 12; ++k) sides.emplace_back(std::cos(k * pi / 6.0), std::sin(k * pi / 6.0));
  const SurfaceSoup prism = extruded(sides, {0.0, 0.0}, 0.5);
  const FineMesh<3> mesh(mesh_surface(prism, {.size = 0.5, .feature_angle = 29.0}));
  EXPECT_EQ(surface_offsets(mesh, prism, 29.0 * pi / 180.0, 0.05).points.cols(), 0);
  EXPECT_GT(surface_offsets(mesh, prism, largest_smooth_angle, 0.05).points.cols(), 0);
}

/// A slab 4 x 1 whose short sides are half circles: the long ones stay flat.
TEST(SurfaceOffsets, AFlatSideIsNotBentByTheRoundingBesideIt) {
  std::vector<Vec<2>> profile;
  for (int k = 0; k <= 8; ++k) profile.emplace_back(2.0 + 0.5 * std::sin(k * pi / 8), -0.5 * std::cos(k * pi / 8));
  for (int k = 0; k <= 8; ++k) profile.emplace_back(-2.0 - 0.5 * std::sin(k * pi / 8), 0.5 * std::cos(k * pi / 8));
  constexpr double size = 0.4;
  const CurvedMesh<3> slab = meshed(extruded(profile, {0.0, 0.0}, 1.0), size);
  expect_true_volume(slab, 4.0 + 0.25 * pi, 0.2);
  // Facets of the mesh that reach across the end of the rounding leave it.
  for (Index k = 0; k < slab.boundary.points.cols(); ++k) EXPECT_GT(std::abs(slab.boundary.points(0, k)), 2.0 - size);
}

/// The wrap lies outside of the surface: it is said by how much.
TEST(SurfaceOffsets, OfAWrapLeadToTheSurfaceInIt) {
  const SurfaceSoup box = test::box_surface({0, 0, 0}, {1, 1, 1});
  const SurfaceWrap wrap = wrap_surface(box, {.alpha = 0.1, .offset = 0.02});
  MeshData<3> data = mesh_surface(wrap.surface, {.size = 0.3});
  auto offsets = surface_offsets(FineMesh<3>(data), box, largest_smooth_angle, 0.07);
  expect_true_volume<3>({.mesh = std::move(data), .boundary = std::move(offsets)}, 1.0, 0.2);
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
