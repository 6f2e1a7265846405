// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/surface.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/geometry/mesh/summary.hpp"
#include "efree/geometry/meshing/surface_image.hpp"
#include "files.hpp"
#include "meshes.hpp"
#include "surfaces.hpp"

#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <numbers>

namespace efree {
namespace {

using namespace efree::test;

using std::numbers::pi;

TEST(Surface, AStepFarBelowTheMeshSizeIsNoSharpEdge) {
  // A block whose top has a step of 1e-4: its two edges, protected, would need thousands of balls of that size.
  const std::vector<Vec<2>> profile{{0, 0}, {1, 0}, {1, 1}, {0.5, 1}, {0.5, 1.0001}, {0, 1.0001}};
  SurfaceSoup soup;
  soup.points.resize(3, 12);
  for (Index k = 0; k < 6; ++k)
    for (const Index z : {0, 1}) soup.points.col(k + 6 * z) << profile[k], z;
  for (Index k = 0; k < 6; ++k) {
    const Index next = (k + 1) % 6;
    soup.triangles.push_back({k, next, next + 6});
    soup.triangles.push_back({k, next + 6, k + 6});
  }
  for (const std::array<Index, 3>& t : {std::array<Index, 3>{0, 1, 3}, {1, 2, 3}, {0, 3, 4}, {0, 4, 5}}) {
    soup.triangles.push_back({t[0], t[2], t[1]});
    soup.triangles.push_back({t[0] + 6, t[1] + 6, t[2] + 6});
  }
  const FineMesh<3> mesh(mesh_surface(soup, {.size = 0.3}));
  EXPECT_LT(mesh.num_vertices(), 2000);
  EXPECT_EQ(mesh.groups().size(), 6u);
  EXPECT_NEAR(mesh.volumes().sum(), 1.00005, 1e-3);
}

TEST(Surface, BoxKeepsItsEdgesAndItsSixSides) {
  SurfaceSoup soup = box_surface({0, 0, 0}, {1, 2, 0.5});
  std::swap(soup.triangles[3][0], soup.triangles[3][1]);  // orientation is nobody's duty
  const MeshData<3> mesh = mesh_surface(soup, {.size = 0.3});
  const auto summary = summarize<3>(mesh);
  EXPECT_NEAR(summary.volume, 1.0, 1e-9);
  EXPECT_LE(summary.largest_edge, 0.3);
  EXPECT_EQ(summary.num_components, 1);
  EXPECT_GT(summary.smallest_angle, 0.5);
  ASSERT_EQ(summary.groups.size(), 6u);
  const double areas[] = {2.0, 2.0, 1.0, 1.0, 0.5, 0.5};
  Vec<3> sum = Vec<3>::Zero();
  for (int g = 0; g < 6; ++g) {
    EXPECT_EQ(summary.groups[g].name, "surface " + std::to_string(g + 1));
    EXPECT_NEAR(summary.groups[g].measure, areas[g], 1e-9);
    ASSERT_TRUE(summary.groups[g].normal.has_value());
    sum += *summary.groups[g].normal;
  }
  EXPECT_LT(sum.norm(), 1e-6);
}

TEST(Surface, FlatCellsGetVolumeAndSidesStayWhereTheyAre) {
  // Regular points on the edges make a cell of four of one plane, which is not that of a side.
  const MeshData<3> mesh = mesh_surface(box_surface({0, 0, 0}, {0.1, 1, 1}), {.size = 0.9});
  double flattest = 1.0;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    flattest = std::min(flattest, internal::flatness<3>(mesh.vertices, mesh.cells, c));
  EXPECT_GT(flattest, 1e-3);
  const auto summary = summarize<3>(mesh);
  EXPECT_NEAR(summary.volume, 0.1, 1e-9);
  EXPECT_NEAR(summary.boundary, 2.4, 1e-9);
  for (const auto& group : summary.groups) EXPECT_TRUE(group.normal.has_value());
}

TEST(Surface, ShellsInsideAreCavitiesHoweverSmall) {
  // The pore is a twentieth of the box and none of its edges is sharp.
  const SurfaceSoup soup = together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.31, 0.7, 0.6}, 0.05, 8));
  const auto summary = summarize<3>(mesh_surface(soup, {.size = 0.25, .distance = 0.005}));
  const double pore = 4.0 / 3.0 * pi * std::pow(0.05, 3);
  EXPECT_NEAR(summary.volume, 1.0 - pore, 0.25 * pore);
  ASSERT_EQ(summary.groups.size(), 7u);
  EXPECT_NEAR(summary.groups[6].measure, 4.0 * pi * 0.05 * 0.05, 0.15 * 4.0 * pi * 0.05 * 0.05);
  EXPECT_FALSE(summary.groups[6].normal.has_value());
}

TEST(Surface, SphereHasItsVolumeAndDisjointBodiesAreAllMeshed) {
  const SurfaceSoup soup = together(sphere_surface({0, 0, 0}, 1.0, 16), sphere_surface({3, 0, 0}, 0.5, 16));
  const auto summary = summarize<3>(mesh_surface(soup, {.size = 0.3}));
  EXPECT_EQ(summary.num_components, 2);
  EXPECT_NEAR(summary.volume, 4.0 / 3.0 * pi * 1.125, 0.04 * 4.0 / 3.0 * pi * 1.125);
  EXPECT_NEAR(summary.boundary, 4.0 * pi * 1.25, 0.03 * 4.0 * pi * 1.25);
  ASSERT_EQ(summary.groups.size(), 2u);
}

TEST(Surface, BodiesThatTouchInAPointOrAnEdgeAreApart) {
  const SurfaceSoup box = box_surface({0, 0, 0}, {1, 1, 1});
  for (const auto& [low, touching] : {std::pair{Vec<3>(1, 1, 1), "point"}, {Vec<3>(1, 1, 0), "edge"}}) {
    // Together as files say them: in the same places, not as the same points.
    const SurfaceSoup soup = together(box, box_surface(low, low + Vec<3>::Ones()));
    const auto summary = summarize<3>(mesh_surface(soup, {.size = 0.4}));
    EXPECT_EQ(summary.num_components, 2) << touching;
    EXPECT_NEAR(summary.volume, 2.0, 1e-9) << touching;
    EXPECT_NEAR(summary.boundary, 12.0, 1e-9) << touching;
  }
  // Bodies with a common face: by the same triangles or by others, a file with no open edge.
  SurfaceSoup next = box_surface({1, 0, 0}, {2, 1, 1});
  EXPECT_INPUT_ERROR(mesh_surface(together(box, next), {.size = 0.4}), "bodies that meet in a common face");
  for (Vec<3> p; auto&& x : next.points.colwise()) p = x, x << p.x(), 1.0 - p.y(), p.z();  // the other diagonals
  EXPECT_INPUT_ERROR(mesh_surface(together(box, next), {.size = 0.4}), "bodies that meet in a common face");
  // A shared part of a side is more than touching.
  EXPECT_INPUT_ERROR(mesh_surface(together(box, box_surface({1, 0.2, 0.2}, {2, 0.8, 0.8})), {.size = 0.4}),
                     "the surface meets itself");
}

TEST(Surface, SameInputGivesTheSameMeshBitForBit) {
  const SurfaceSoup soup = together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.5, 0.5, 0.5}, 0.2, 8));
  const MeshData<3> first = mesh_surface(soup, {.size = 0.3});
  const std::vector<double> stir(100000, 1.0);
  const MeshData<3> second = mesh_surface(soup, {.size = 0.3});
  EXPECT_EQ(first.vertices, second.vertices);
  EXPECT_EQ(first.cells, second.cells);
}

TEST(Surface, RefusesWhatBoundsNoBody) {
  SurfaceSoup open = box_surface({0, 0, 0}, {1, 1, 1});
  open.triangles.resize(10);
  EXPECT_INPUT_ERROR(mesh_surface(open, {.size = 0.2}),
                     "open surface given as closed: 4 boundary edges, first at (1, ");
  const SurfaceSoup crossing =
      together(box_surface({0, 0, 0}, {1, 1, 1}), box_surface({0.5, 0.25, 0.25}, {2, 0.75, 0.75}));
  EXPECT_INPUT_ERROR(mesh_surface(crossing, {.size = 0.2}), "the surface meets itself: ");
  EXPECT_INPUT_ERROR(mesh_surface({}, {.size = 0.2}), "there is no triangle in it");
  EXPECT_INPUT_ERROR(mesh_surface(box_surface({0, 0, 0}, {1, 1, 1}), {}), "size is 0, expected a positive length");
  EXPECT_INPUT_ERROR(mesh_surface(box_surface({0, 0, 0}, {1, 1, 1}), {.size = 1e-6}), "mesh size 1e-06 is too small");
  // No thicker than what the mesher may leave between its boundary and the surface.
  EXPECT_INPUT_ERROR(mesh_surface(box_surface({0, 0, 0}, {0.05, 1, 1}), {.size = 0.9}),
                     "of a volume of 0.05: a mesh size of 0.9 is too coarse for the body, whose thin parts or small "
                     "radii are lost; take a smaller one");
  EXPECT_INPUT_ERROR(mesh_surface(box_surface({0, 0, 0}, {0.05, 1, 1}), {.size = 0.9, .distance = 0.06}),
                     "size of 0.9 with a distance of 0.06 is too coarse for the body, whose thin parts or small radii "
                     "are lost; take smaller ones");
  EXPECT_INPUT_ERROR(mesh_surface(sphere_surface({0, 0, 0}, 1.0, 16), {.size = 3.0}),
                     "of a volume of 4.122: a mesh size of 3 is too coarse for the body, whose thin");
  const SurfaceSoup hollow = together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.5, 0.5, 0.5}, 0.3, 8));
  EXPECT_INPUT_ERROR(mesh_surface(hollow, {.size = 5.0}), "of a volume of 0.894: a mesh size of 5 is too coarse for");
  SurfaceSoup flat = box_surface({0, 0, 0}, {1, 1, 0});
  EXPECT_THROW(mesh_surface(flat, {.size = 0.2}), InputError);
}

TEST(Surface, WrapClosesHolesAndSaysHowFarItIs) {
  SurfaceSoup dirty = box_surface({0, 0, 0}, {1, 1, 1});
  dirty = together(dirty, box_surface({0.5, 0.25, 0.25}, {1.5, 0.75, 0.75}));  // runs through a side
  dirty.triangles.push_back(dirty.triangles[0]);
  const SurfaceWrap wrap = wrap_surface(dirty, {.alpha = 0.1, .offset = 0.01});
  EXPECT_NEAR(wrap.volume, 1.125, 0.1);
  EXPECT_GT(wrap.volume, 1.125);
  EXPECT_GT(wrap.max_distance, 0.005);
  EXPECT_LT(wrap.max_distance, 0.1);  // alpha: where the two boxes meet
  EXPECT_LE(wrap.mean_distance, wrap.max_distance);
  const auto summary = summarize<3>(mesh_surface(wrap.surface, {.size = 0.3, .feature_angle = 180.0}));
  EXPECT_NEAR(summary.volume, wrap.volume, 0.02);
  EXPECT_INPUT_ERROR(wrap_surface({}), "there is no triangle");
  EXPECT_INPUT_ERROR(wrap_surface(dirty, {.alpha = -1.0}), "alpha is -1");
  EXPECT_INPUT_ERROR(wrap_surface(dirty, {.alpha = 1e-6}), "too small for a box");
}

/// Volume and bodies of what a surface encloses, on a lattice.
auto summary_on_lattice(const SurfaceSoup& soup, double size) {
  return summarize<3>(mesh_surface_on_lattice(soup, size).mesh);
}

TEST(SurfaceOnLattice, SphereConvergesWithTheSquareOfTheEdges) {
  const SurfaceSoup sphere = sphere_surface({0, 0, 0}, 1.0, 60);
  double volume = 0.0;
  for (const auto& [a, b, c] : sphere.triangles)
    volume += std::abs(sphere.points(Eigen::all, std::array{a, b, c}).determinant()) / 6.0;
  std::vector<double> errors;
  for (const double size : {0.4, 0.2, 0.1})
    errors.push_back(std::abs(summary_on_lattice(sphere, size).volume - volume) / volume);
  EXPECT_LT(errors.back(), 0.006);
  for (int k = 0; k < 2; ++k) {
    EXPECT_GT(errors[k] / errors[k + 1], 2.5);
    EXPECT_LT(errors[k] / errors[k + 1], 6.0);
  }
}

TEST(SurfaceOnLattice, BodiesThatCrossAreOneAndThoseApartAreTwo) {
  const SurfaceSoup boxes =
      together(box_surface({0, 0, 0}, {1, 1, 1}), box_surface({0.5, 0.25, 0.25}, {1.5, 0.75, 0.75}));
  const auto crossing = summary_on_lattice(boxes, 0.05);
  EXPECT_NEAR(crossing.volume, 1.125, 0.01);
  EXPECT_EQ(crossing.num_components, 1);
  ASSERT_EQ(crossing.groups.size(), 1u);
  EXPECT_EQ(crossing.groups[0].name, "surface 1");
  const auto apart =
      summary_on_lattice(together(sphere_surface({0, 0, 0}, 1.0, 16), sphere_surface({3, 0, 0}, 0.5, 16)), 0.1);
  EXPECT_EQ(apart.num_components, 2);
}

TEST(SurfaceOnLattice, ShellsInsideThatFaceInwardAreCavities) {
  SurfaceSoup pore = sphere_surface({0.5, 0.5, 0.5}, 0.3, 24);
  for (auto& t : pore.triangles) std::swap(t[0], t[1]);
  const SurfaceSoup box = box_surface({0, 0, 0}, {1, 1, 1});
  const double volume = 1.0 - 4.0 / 3.0 * pi * 0.027;
  EXPECT_NEAR(summary_on_lattice(together(box, pore), 0.05).volume, volume, 0.01);
  // All of it inside out.
  SurfaceSoup turned = together(box, pore);
  for (auto& t : turned.triangles) std::swap(t[0], t[1]);
  EXPECT_NEAR(summary_on_lattice(turned, 0.05).volume, volume, 0.01);
}

TEST(SurfaceOnLattice, ShellsInsideOthersAreCavitiesWhicheverWayTheyFace) {
  const SurfaceSoup hollow = together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.5, 0.5, 0.5}, 0.3, 24)),
                    core = together(hollow, box_surface({0.4, 0.4, 0.4}, {0.6, 0.6, 0.6}));  // loose in the cavity
  const double cavity = 4.0 / 3.0 * pi * 0.027;
  const SurfaceLattice mesh = mesh_surface_on_lattice(hollow, 0.05);
  EXPECT_NEAR(summarize<3>(mesh.mesh).volume, 1.0 - cavity, 0.01);
  EXPECT_EQ(mesh.shells_turned, 1);
  EXPECT_EQ(mesh.turned, static_cast<Index>(hollow.triangles.size()) - 12);
  const SurfaceLattice within = mesh_surface_on_lattice(core, 0.05);
  EXPECT_NEAR(summarize<3>(within.mesh).volume, 1.0 - cavity + 0.008, 0.01);
  EXPECT_EQ(summarize<3>(within.mesh).num_components, 2);
  EXPECT_EQ(within.shells_turned, 1);
  // A body of its own that faces inward.
  SurfaceSoup apart = sphere_surface({3, 0.5, 0.5}, 0.4, 24);
  for (auto& t : apart.triangles) std::swap(t[0], t[1]);
  const SurfaceLattice two = mesh_surface_on_lattice(together(box_surface({0, 0, 0}, {1, 1, 1}), apart), 0.05);
  EXPECT_EQ(summarize<3>(two.mesh).num_components, 2);
  EXPECT_EQ(two.shells_turned, 1);
}

TEST(SurfaceOnLattice, ClosesHolesAndTurnsTrianglesAndSaysSo) {
  SurfaceSoup dirty = sphere_surface({0, 0, 0}, 1.0, 24);
  const double clean = summary_on_lattice(dirty, 0.1).volume;
  EXPECT_EQ(mesh_surface_on_lattice(dirty, 0.1).turned, 0);
  EXPECT_EQ(mesh_surface_on_lattice(dirty, 0.1).closed, 0.0);
  SurfaceSoup kept = dirty;
  kept.triangles.clear();
  Index turned = 0;
  for (std::size_t k = 0; k < dirty.triangles.size(); ++k) {
    const Vec<3> at = dirty.points.col(dirty.triangles[k][0]);
    if ((at - Vec<3>(1, 0, 0)).norm() < 0.35) continue;  // a hole
    auto t = dirty.triangles[k];
    if (k % 17 == 0) std::swap(t[0], t[1]), ++turned;
    kept.triangles.push_back(t);
    if (k % 23 == 0) kept.triangles.push_back(t);
  }
  const SurfaceLattice mesh = mesh_surface_on_lattice(kept, 0.1);
  const double volume = summarize<3>(mesh.mesh).volume;
  // What the hole's patch is flatter than the sphere: at most the cap above its rim.
  const double height = 0.35 * 0.35 / 2.0, cap = pi * height * height * (1.0 - height / 3.0);
  EXPECT_NEAR(volume, clean, 1.5 * cap + 0.002 * clean);
  EXPECT_EQ(mesh.turned, turned);
  EXPECT_GT(mesh.closed, 0.002);
  EXPECT_LT(mesh.closed, 0.35 * 0.35 / 4.0);  // the hole's share of the sphere
}

TEST(SurfaceOnLattice, OneAndTwoThreadsAgreeBitwise) {
  const SurfaceSoup soup = together(box_surface({0, 0, 0}, {1, 1, 1}), sphere_surface({0.9, 0.5, 0.5}, 0.3, 12));
  set_num_threads(1);
  const MeshData<3> one = mesh_surface_on_lattice(soup, 0.06).mesh;
  set_num_threads(2);
  const MeshData<3> two = mesh_surface_on_lattice(soup, 0.06).mesh;
  set_num_threads(1);
  EXPECT_EQ(one.vertices, two.vertices);
  EXPECT_EQ(one.cells, two.cells);
}

TEST(SurfaceOnLattice, RefusesWhatEnclosesNothing) {
  SurfaceSoup sheet = box_surface({0, 0, 0}, {1, 1, 1});
  sheet.triangles.resize(2);
  EXPECT_INPUT_ERROR(mesh_surface_on_lattice(sheet, 0.1), "the surface has no inside");
  EXPECT_INPUT_ERROR(mesh_surface_on_lattice({}, 0.1), "there is no triangle");
  EXPECT_INPUT_ERROR(mesh_surface_on_lattice(box_surface({0, 0, 0}, {1, 1, 1}), 0.0), "voxels of 0, expected > 0");
  EXPECT_INPUT_ERROR(mesh_surface_on_lattice(box_surface({0, 0, 0}, {1, 1, 0}), 0.1), "the surface has no inside");
}

const char* const tetrahedron_off = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

TEST(Surface, ReadsEveryFormat) {
  EXPECT_EQ(read_surface(file("t.off", tetrahedron_off)).triangles.size(), 4u);
  const SurfaceSoup obj = read_surface(
      file("t.OBJ", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 4 3 2\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"));
  EXPECT_EQ(obj.points.cols(), 5);
  EXPECT_EQ(obj.triangles.size(), 6u);  // the square is cut in two
  const SurfaceSoup stl = read_surface(file(
      "t.stl",
      "solid t\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
      "facet normal 0 0 0\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid t\n"));
  EXPECT_EQ(stl.points.cols(), 4);
  EXPECT_EQ(stl.triangles.size(), 2u);
  const SurfaceSoup ply = read_surface(
      file("t.ply",
           "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
           "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"));
  EXPECT_EQ(ply.triangles.size(), 1u);
}

TEST(Surface, RefusesFilesThatAreNotWhatTheySay) {
  EXPECT_INPUT_ERROR(read_surface("nowhere/t.stl"), "nowhere/t.stl: cannot read the file");
  EXPECT_INPUT_ERROR(read_surface("t.xyz"), "expected a surface as .stl, .off, .obj or .ply");
  EXPECT_INPUT_ERROR(read_surface(file("empty.stl", "")), "the file is empty");
  EXPECT_INPUT_ERROR(read_surface(file("text.stl",
                                       "Dear reader,\nthis is a letter and no surface at all. It goes on for "
                                       "a while, longer than the head of a binary file is.\n")),
                     "");
  EXPECT_INPUT_ERROR(read_surface(file("text.off", "Dear reader\n")), "the file is truncated or no off file");
  EXPECT_INPUT_ERROR(read_surface(file("text.ply", "Dear reader\n")), "the file is truncated or no ply file");
  EXPECT_INPUT_ERROR(read_surface(file("text.obj", "Dear reader\n")), "text.obj: ");
  EXPECT_INPUT_ERROR(read_surface(file("cut.off", std::string(tetrahedron_off).substr(0, 50))), "truncated");
  EXPECT_INPUT_ERROR(read_surface(file("cut.stl", "solid t\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0")),
                     "");
  EXPECT_INPUT_ERROR(read_surface(file("cut2.stl", std::string(80, 'x') + std::string("\x05\x00\x00\x00", 4) + "abc")),
                     "truncated");
  EXPECT_INPUT_ERROR(read_surface(file("nan.off", "OFF\n3 1 0\n0 0 0\n1 0 0\nnan 1 0\n3 0 1 2\n")), "nan.off: ");
  EXPECT_INPUT_ERROR(read_surface(file("index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")), "index.off: ");
}

TEST(Summary, PlanarMeshesToo) {
  MeshData<2> mesh;
  mesh.vertices.resize(2, 5);
  mesh.vertices << 0, 9, 1, 1, 0, 0, 9, 0, 1, 1;  // vertex 1 has no cell
  mesh.cells.resize(3, 2);
  mesh.cells << 0, 0, 2, 4, 3, 3;
  mesh.groups = {{"left", {{0, 4}}}, {"diagonal", {{3, 0}}}, {"corner", {{0, 2}, {2, 3}}}};
  mesh.regions = {0, 1};
  mesh.region_names = {"low", "high"};
  const auto summary = summarize<2>(mesh);
  EXPECT_DOUBLE_EQ(summary.volume, 1.0);
  EXPECT_DOUBLE_EQ(summary.boundary, 4.0);
  EXPECT_DOUBLE_EQ(summary.smallest_edge, 1.0);
  EXPECT_DOUBLE_EQ(summary.largest_edge, std::sqrt(2.0));
  EXPECT_NEAR(summary.smallest_angle, 45.0, 1e-10);
  ASSERT_EQ(summary.bodies.size(), 2u);
  EXPECT_EQ(summary.bodies[1].name, "high");
  EXPECT_DOUBLE_EQ(summary.bodies[1].volume, 0.5);
  EXPECT_EQ(summary.box.max(), Vec<2>(1.0, 1.0));
  ASSERT_EQ(summary.groups.size(), 3u);
  EXPECT_LT((*summary.groups[0].normal - Vec<2>(-1.0, 0.0)).norm(), 1e-15);
  EXPECT_DOUBLE_EQ(summary.groups[1].measure, std::sqrt(2.0));
  EXPECT_NEAR(std::abs(summary.groups[1].normal->dot(Vec<2>(1.0, -1.0).normalized())), 1.0, 1e-15);
  EXPECT_FALSE(summary.groups[2].normal.has_value());
  EXPECT_EQ(summary.groups[2].box.min(), Vec<2>(0.0, 0.0));
}

}  // namespace
}  // namespace efree
