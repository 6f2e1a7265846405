// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/locator.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "meshes.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <functional>
#include <random>

namespace efree {
namespace {

/// Barycentric coordinates from their definition: they sum to one and weigh the corners so that x is their mean.
template <int Dim>
Eigen::Matrix<double, Dim + 1, 1> barycentric(const FineMesh<Dim>& mesh, Index c, const Vec<Dim>& x) {
  Eigen::Matrix<double, Dim + 1, Dim + 1> corners;
  corners.template topRows<Dim>() = mesh.vertices()(Eigen::all, mesh.cells().col(c));
  corners.row(Dim).setOnes();
  return corners.inverse() * x.homogeneous();
}

/// Random points of the box around the mesh: the locator that walks and the one with a tree agree bitwise, on the cell
/// that holds the point; both refuse those in no cell, unless they lie in the body whose mesh it is (`depth` below its
/// boundary), beyond its facets.
template <int Dim>
void expect_found(const FineMesh<Dim>& mesh, const std::function<double(const Vec<Dim>&)>& depth = {}) {
  const Locator<Dim> walk(mesh, 1), tree(mesh);
  const Vec<Dim> low = mesh.vertices().rowwise().minCoeff(), high = mesh.vertices().rowwise().maxCoeff();
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  int inside = 0, outside = 0;
  double worst = 0.0;
  for (int k = 0; k < 300; ++k) {
    Vec<Dim> x;
    for (int d = 0; d < Dim; ++d) x[d] = low[d] + uniform(random) * (high[d] - low[d]);
    Index holder = -1;
    for (Index c = 0; c < mesh.num_cells() && holder < 0; ++c)
      if (barycentric(mesh, c, x).minCoeff() >= 0.0) holder = c;
    if (holder < 0 && depth && depth(x) > -0.1 * mesh.size()) {
      if (depth(x) < 0.0) continue;  // as far outside as chords may be off: either will do
      const auto a = walk(x), b = tree(x);
      EXPECT_EQ(a.cell, b.cell);
      EXPECT_EQ(a.at, b.at);
      Vec<Dim> found = Vec<Dim>::Zero();
      for (int i = 0; i <= Dim; ++i) found += a.at[i] * mesh.vertex(mesh.cells()(i, a.cell));
      EXPECT_LT((found - x).norm(), 0.1 * mesh.size());
      continue;
    }
    if (holder < 0) {
      ++outside;
      EXPECT_INPUT_ERROR(walk(x), "lies outside the body");
      EXPECT_INPUT_ERROR(tree(x), "lies outside the body");
      continue;
    }
    ++inside;
    const auto a = walk(x), b = tree(x);
    EXPECT_EQ(a.cell, holder);
    EXPECT_EQ(b.cell, holder);
    EXPECT_EQ(a.at, b.at);
    worst = std::max(worst, (b.at - barycentric(mesh, holder, x)).cwiseAbs().maxCoeff());
  }
  EXPECT_GT(inside, 100);
  EXPECT_GT(outside, 10);
  EXPECT_LT(worst, 1e-11);
}

/// Several cells hold a vertex.
template <int Dim> void expect_vertices_found(const FineMesh<Dim>& mesh) {
  const Locator<Dim> walk(mesh, 1), tree(mesh);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const auto a = walk(mesh.vertex(v)), b = tree(mesh.vertex(v));
    EXPECT_EQ(a.cell, b.cell);
    EXPECT_EQ(a.at, b.at);
    EXPECT_TRUE(std::ranges::binary_search(mesh.cells_of(v), b.cell));
    EXPECT_NEAR(b.at.maxCoeff(), 1.0, 1e-11);
  }
}

FineMesh<2> plate() {
  return triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, 0.2), {.size = 0.2});
}
FineMesh<3> hollow_sphere() {
  return FineMesh<3>(solids::thick_sphere(1.0, 2.0, 0.4));
}

TEST(Locator, FindsTheCellThatHoldsAPoint) {
  expect_found(plate());
  expect_found<3>(hollow_sphere(), [](const Vec<3>& x) { return x.norm() > 1.5 ? 2.0 - x.norm() : -1.0; });
}

TEST(Locator, FindsVertices) {
  expect_vertices_found(plate());
  expect_vertices_found(hollow_sphere());
}

TEST(Locator, OfSeveralCellsTheFirst) {
  // Two squares of two triangles each; all numbers are exact but the third in the centroids' coordinates.
  MeshData<2> data;
  data.vertices.resize(2, 6);
  data.vertices << 0, 3, 6, 0, 3, 6, 0, 0, 0, 3, 3, 3;
  data.cells.resize(3, 4);
  data.cells << 1, 1, 0, 0, 2, 5, 1, 4, 5, 4, 4, 3;
  const FineMesh<2> mesh(data);
  for (const std::size_t points : {1, 1000}) {
    const Locator<2> locator(mesh, points);
    EXPECT_EQ(locator({3.0, 0.0}).cell, 0);
    EXPECT_EQ(locator({3.0, 1.5}).cell, 1);
    EXPECT_EQ(locator({1.0, 1.0}).cell, 2);
  }
}

TEST(Locator, RoundingOutsideIsInsideAndMoreNamesTheNearestVertex) {
  const FineMesh<3> box(solids::box({1.0, 2.0, 3.0}, 0.5));
  for (const std::size_t points : {1, 1000}) {
    const Locator<3> locator(box, points);
    const auto there = locator({1.0 + 1e-11, 1.0, 1.0});
    EXPECT_LT(there.at.minCoeff(), 0.0);
    EXPECT_GT(there.at.minCoeff(), -1e-9);
    EXPECT_INPUT_ERROR(locator({1.1, 2.2, 3.3}),
                       "(1.1, 2.2, 3.3) lies outside the body; the nearest fine vertex is (1, 2, 3)");
    EXPECT_INPUT_ERROR(locator({2.0, 1e300, 0.0}), "lies outside the body");  // its square is no number
  }
  EXPECT_INPUT_ERROR(locate(box, Vec<3>(-1.0, -1.0, -1.0)), "the nearest fine vertex is (0, 0, 0)");
}

TEST(Locator, PointsOutsideByTheRoundingOfFilesAreOnTheBoundary) {
  const FineMesh<3> box(solids::box({1.0, 2.0, 2.0}, 0.5));  // of diagonal 3
  const Vec<3> low = box.vertices().rowwise().minCoeff(), high = box.vertices().rowwise().maxCoeff();
  const Vec<3> side(high.x(), 0.5 * (low.y() + high.y()) + 0.1, 0.5 * (low.z() + high.z()) + 0.2);
  const Location<3> there = locate<3>(box, side + Vec<3>(2.9e-6, 0, 0));
  EXPECT_GE(there.at.minCoeff(), 0.0);
  Vec<3> found = Vec<3>::Zero();
  for (int i = 0; i < 4; ++i) found += there.at[i] * box.vertex(box.cells()(i, there.cell));
  EXPECT_LT((found - side).norm(), 1e-12);
  EXPECT_INPUT_ERROR(locate<3>(box, side + Vec<3>(3.1e-6, 0, 0)), "lies outside the body");
}

}  // namespace
}  // namespace efree
