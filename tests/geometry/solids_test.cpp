// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/gmsh_reader.hpp"
#include "efree/geometry/refine.hpp"
#include "efree/geometry/solid_shapes.hpp"
#include "meshes.hpp"

#include <fstream>
#include <map>
#include <numbers>

namespace efree {
namespace {

constexpr double pi = std::numbers::pi;

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
  EXPECT_INPUT_ERROR(solids::box({1.0, 2.0, 1.0}, 0.0), "box: size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(solids::box({1.0, 2.0, 1.0}, 1e-5), "box: mesh size 1e-05 is too small for a body 2 wide");
  EXPECT_INPUT_ERROR(solids::spherical_cavity(2.0, 1.0, 0.1), "expected 0 < radius < half width");
  EXPECT_INPUT_ERROR(solids::thick_cylinder(2.0, 1.0, 1.0, 0.1), "expected 0 < inner < outer");
  EXPECT_INPUT_ERROR(solids::thick_sphere(2.0, 1.0, 0.1), "expected 0 < inner < outer");
  EXPECT_INPUT_ERROR(solids::cylinder(1.0, 0.0, 0.1), "expected positive ones");
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
