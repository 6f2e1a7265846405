// SPDX-License-Identifier: GPL-3.0-or-later
/// Fast marching and the heat method against exact distances; Delaunay flips.
#include "domains.hpp"

#include <gtest/gtest.h>

namespace efree::testing {
namespace {

struct Case {
  std::string name;
  FineMesh<2> mesh;
  std::function<double(const FineMesh<2>&, Index, Index)> exact;
  double radius;
};

std::vector<Case> cases(double h) {
  const auto straight = [](const FineMesh<2>& m, Index a, Index b) { return (m.vertex(a) - m.vertex(b)).norm(); };
  const auto around_disc = [](const FineMesh<2>& m, Index a, Index b) {
    return disc_distance(0.5, m.vertex(a), m.vertex(b));
  };
  return {
      {"square", triangulate(shapes::rectangle(-1, -1, 1, 1), {.size = h}), straight, 0.7},
      {"slit", slit_square(h), slit_distance, 0.7},
      {"annulus", triangulate(shapes::annulus(0.5, 1.5, 0.5 * h), {.size = h}), around_disc, 0.9},
      {"square with slivers", with_slivers(triangulate(shapes::rectangle(-1, -1, 1, 1), {.size = h})), straight, 0.7},
      {"slit with slivers", with_slivers(slit_square(h)), slit_distance, 0.7}};
}

void expect_accurate(Weight engine, double h, double mean, double largest) {
  for (const Case& c : cases(h)) {
    const Geodesics<2> geodesics(c.mesh, {.engine = engine, .always_solve = true});
    std::vector<Index> sources = random_vertices(c.mesh, 40, 1);
    sources.push_back(vertex_near(c.mesh, {-0.3, 0.0}, {0.0, 1.0}));
    sources.push_back(vertex_near(c.mesh, {0.0, 0.0}));
    const auto exact = [&](Index a, Index b) { return c.exact(c.mesh, a, b); };
    const DistanceError error = distance_error(c.mesh, geodesics, sources, c.radius, 0.25, exact);
    EXPECT_LT(error.mean, mean) << c.name << ", h = " << h;
    EXPECT_LT(error.largest, largest) << c.name << ", h = " << h;
  }
}

TEST(FastMarching, IsWithinATenthOfAPerMilleOfTheRadiusOnAverage) {
  expect_accurate(Weight::fast_marching, 0.07, 1e-4, 0.015);
}

TEST(HeatMethod, IsWithinOnePerCentOfTheRadiusOnAverage) {
  expect_accurate(Weight::heat_geodesic, 0.14, 0.010, 0.2);
  expect_accurate(Weight::heat_geodesic, 0.07, 0.006, 0.12);
  expect_accurate(Weight::heat_geodesic, 0.035, 0.003, 0.08);
}

TEST(HeatMethod, SharingAFactorisationHardlyMatters) {
  const FineMesh<2> mesh = slit_square(0.07);
  const Geodesics<2> geodesics(mesh, {.engine = Weight::heat_geodesic});
  const auto sources = random_vertices(mesh, 60, 4);
  const auto together = geodesics.from(sources, Vector::Constant(60, 0.6));
  for (int s = 0; s < 60; ++s) {
    const LocalField alone = geodesics.from(sources[s], 0.6);
    for (std::size_t i = 0, j = 0; i < alone.vertices.size(); ++i) {
      while (j < together[s].vertices.size() && together[s].vertices[j] < alone.vertices[i]) ++j;
      if (j == together[s].vertices.size() || together[s].vertices[j] != alone.vertices[i]) {
        EXPECT_GT(alone.values[i], 0.55) << "only at the rim may a vertex come and go";
        continue;
      }
      EXPECT_NEAR(alone.values[i], together[s].values[j], 0.05 * 0.6);
    }
  }
}

TEST(DelaunayCells, HaveNoVertexInsideACircumcircleOfANeighbour) {
  const FineMesh<2> slit = slit_square(0.1), bad = with_slivers(slit);
  const FineMesh<2> mesh(MeshData<2>{bad.vertices(), delaunay_cells(bad), {}});
  ASSERT_EQ(mesh.num_cells(), bad.num_cells());
  ASSERT_EQ(mesh.num_facets(), bad.num_facets()) << "the slit stays open";
  EXPECT_NEAR(mesh.volumes().sum(), 4.0, 1e-13);
  const auto cotangent = [&](Index i, Index c) {
    const auto gradients = mesh.hat_gradients(c);
    return -2.0 * mesh.volume(c) * gradients.col((i + 1) % 3).dot(gradients.col((i + 2) % 3));
  };
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (Index i = 0; i < 3; ++i) {
      const Index n = mesh.neighbour(i, c);
      if (n < 0) continue;
      const Index j = mesh.neighbour(0, n) == c ? 0 : mesh.neighbour(1, n) == c ? 1 : 2;
      EXPECT_GE(cotangent(i, c) + cotangent(j, n), -1e-9) << "edge opposite " << i << " of cell " << c;
    }
}

}  // namespace
}  // namespace efree::testing
