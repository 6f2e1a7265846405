// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/mesh/summary.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "image_meshes.hpp"
#include "meshes.hpp"

#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using internal::flatness, internal::least_flatness;
using test::flattest;

MeshData<3> mesh_of(const std::vector<Vec<3>>& points, const std::vector<std::array<Index, 4>>& cells) {
  MeshData<3> mesh;
  mesh.vertices.resize(3, static_cast<Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v) mesh.vertices.col(static_cast<Index>(v)) = points[v];
  mesh.cells.resize(4, static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size(); ++c)
    for (int i = 0; i < 4; ++i) mesh.cells(i, static_cast<Index>(c)) = cells[c][i];
  return mesh;
}

/// A square with a point above and one below, its diagonal seen from above not that seen from below: between them is a
/// cell without volume.
MeshData<3> pillow() {
  return mesh_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.4, 0.5, 1}, {0.5, 0.6, -1}},
                 {{0, 1, 2, 4}, {0, 2, 3, 4}, {1, 0, 3, 5}, {2, 1, 3, 5}, {0, 1, 2, 3}});
}

TEST(FlatCells, FlatnessIsThatOfSimplexesOfAnySize) {
  Points<2> triangle(2, 3);
  triangle << 0, 2, 1, 0, 0, std::sqrt(3.0);
  EXPECT_NEAR(flatness<2>(triangle, Cells<2>{{0}, {1}, {2}}, 0), std::sqrt(0.75), 1e-15);
  Points<3> tetrahedron(3, 4);
  tetrahedron << 0, 3, 3, 0, 0, 3, 0, 3, 0, 0, 3, 3;
  EXPECT_NEAR(flatness<3>(tetrahedron, Cells<3>{{1}, {0}, {2}, {3}}, 0), std::sqrt(0.5), 1e-15);
  EXPECT_NEAR(flatness<3>(tetrahedron, Cells<3>{{0}, {1}, {2}, {3}}, 0), -std::sqrt(0.5), 1e-15);
}

TEST(FlatCells, LayersOfThemArePeeledOffAFlatSide) {
  // Points of the plane z = 0 and one below. A flat cell on the boundary hides another, which comes first.
  MeshData<3> mesh = mesh_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {2, 0.8, 0}, {0.8, 0.5, -1}},
                             {{1, 4, 2, 3}, {0, 1, 2, 3}, {1, 0, 3, 5}, {4, 1, 3, 5}, {2, 4, 3, 5}});
  mesh.groups = {{"top", {{0, 1, 2}, {0, 2, 3}, {1, 4, 2}}}};
  internal::peel_flat_cells(mesh);
  ASSERT_EQ(mesh.cells.cols(), 3);
  const auto summary = summarize<3>(mesh);
  EXPECT_NEAR(summary.volume, (1.0 + 0.5) / 3.0, 1e-15);
  EXPECT_NEAR(summary.groups[0].measure, 1.5, 1e-15);
  EXPECT_EQ(FineMesh<3>(mesh).group("top").size(), 3u);
}

TEST(FlatCells, NoneIsPeeledThatWouldPinchTheBody) {
  // Two bodies below, apart from each other but for the edge in which the flat cell would leave them.
  MeshData<3> mesh = mesh_of({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.2, 0.2, -1}, {0.8, 0.8, -1}},
                             {{1, 0, 3, 4}, {2, 1, 3, 5}, {0, 1, 2, 3}});
  mesh.groups = {{"top", {{0, 1, 2}, {0, 2, 3}}}, {"ridge", {{1, 3, 4}, {1, 3, 5}}}};
  internal::peel_flat_cells(mesh);
  EXPECT_EQ(mesh.cells.cols(), 3);
  mesh.groups.pop_back();  // the same cell where nothing is known of a ridge
  internal::peel_flat_cells(mesh);
  EXPECT_EQ(mesh.cells.cols(), 2);
}

TEST(FlatCells, AreInflatedByAMoveWithinReach) {
  constexpr double reach = 0.003;
  const MeshData<3> flat = pillow();
  ASSERT_EQ(flattest(flat), 0.0);
  MeshData<3> mesh = flat;
  internal::inflate_flat_cells(mesh, reach, std::vector<char>(6, 0));
  EXPECT_GE(flattest(mesh), least_flatness);
  const auto moves = (mesh.vertices - flat.vertices).colwise().norm().eval();
  EXPECT_EQ((moves.array() > 0.0).count(), 1);
  EXPECT_LE(moves.maxCoeff(), reach * (1 + 1e-12));

  mesh = flat;
  internal::inflate_flat_cells(mesh, reach, {1, 0, 1, 1, 1, 1});
  EXPECT_GE(flattest(mesh), least_flatness);
  EXPECT_NE(mesh.vertices.col(1), flat.vertices.col(1));

  mesh = flat;
  EXPECT_THAT([&] { internal::inflate_flat_cells(mesh, reach, std::vector<char>(6, 1)); },
              ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("none of its vertices can move")));
}

TEST(FlatCells, AreInflatedWhereThatFlattensANeighbour) {
  // The corner that lifts the flat cell of the pillow falls with that into the plane of another cell, which was no flat
  // one before: the best for both is to leave that one below the bound.
  const MeshData<3> pillow_alone = pillow();
  std::vector<Vec<3>> points(pillow_alone.vertices.colwise().begin(), pillow_alone.vertices.colwise().end());
  constexpr double height = 7.5e-4, reach = 0.003;
  points.insert(points.end(), {{2, 0, height}, {2, 0.5, height}, {1.4, 0.4, height}});
  const MeshData<3> mesh =
      mesh_of(points, {{0, 1, 2, 4}, {0, 2, 3, 4}, {1, 0, 3, 5}, {2, 1, 3, 5}, {0, 1, 2, 3}, {1, 6, 7, 8}});
  ASSERT_GT(flatness<3>(mesh.vertices, mesh.cells, 5), least_flatness);

  std::vector<char> is_fixed(9, 1);
  is_fixed[1] = 0;
  MeshData<3> moved = mesh;
  EXPECT_THROW(internal::inflate_flat_cells(moved, reach, is_fixed), NumericalError);
  is_fixed[7] = 0;
  moved = mesh;
  internal::inflate_flat_cells(moved, reach, is_fixed);
  EXPECT_GE(flattest(moved), least_flatness);
  EXPECT_NE(moved.vertices.col(1), mesh.vertices.col(1));
  EXPECT_NE(moved.vertices.col(7), mesh.vertices.col(7));
}

TEST(FlatCells, VerticesOfTheSurfaceStayWithinReachOfItInAll) {
  // One move to the end of the reach does not do; a second one would, and go beyond.
  const MeshData<3> flat = pillow();
  const double reach = 0.9 * least_flatness * std::pow(2.0, 1.5);
  for (Index free = 0; free < 4; ++free) {
    std::vector<char> is_fixed(6, 1);
    is_fixed[free] = 0;
    MeshData<3> mesh = flat;
    EXPECT_THROW(internal::inflate_flat_cells(mesh, reach, is_fixed), NumericalError) << "vertex " << free;
    EXPECT_LE((mesh.vertices - flat.vertices).colwise().norm().maxCoeff(), reach * (1 + 1e-9)) << "vertex " << free;
  }
}

TEST(FlatCells, AreNotLeftInImages) {
  const auto image =
      keep_largest(random_spheres<3>(12, {.porosity = 0.3, .r_min = 2.0, .r_max = 4.0, .seed = 8})).image;
  EXPECT_GE(flattest(mesh_image<3>(image, {.size = 2.0, .mesher = Mesher::delaunay})), least_flatness);
}

}  // namespace
}  // namespace efree
