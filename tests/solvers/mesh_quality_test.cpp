// SPDX-License-Identifier: GPL-3.0-or-later
/// The quality of the fine triangulation must not matter. Plate with a hexagonal hole, meshed by equilateral cells;
/// every third cell is split in three at a point that slides from its centroid (smallest angle 30 degrees) towards one
/// edge (0.1 degree). Geometry, fine mesh size, number of vertices, nodes and quadrature nodes stay the same.
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

/// Rhombus of 2n x 2n equilateral cells with edges h, sides named foot and head, without the hexagon of radius n/3 in
/// the middle.
FineMesh<2> rhombus_with_hole(int n, double h) {
  MeshData<2> data;
  const auto number = [n](int i, int j) { return j * (n + 1) + i; };
  data.vertices.resize(2, (n + 1) * (n + 1));
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) data.vertices.col(number(i, j)) = h * Vec<2>(i + 0.5 * j, std::sqrt(0.75) * j);
  const auto in_hole = [n](double i, double j) {  // hexagonal distance from the middle
    const double a = i - 0.5 * n, b = j - 0.5 * n;
    return std::max({std::abs(a), std::abs(b), std::abs(a + b)}) < n / 6.0;
  };
  std::vector<Eigen::Vector3i> cells;
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      if (!in_hole(i + 1.0 / 3.0, j + 1.0 / 3.0)) cells.emplace_back(number(i, j), number(i + 1, j), number(i, j + 1));
      if (!in_hole(i + 2.0 / 3.0, j + 2.0 / 3.0))
        cells.emplace_back(number(i + 1, j), number(i + 1, j + 1), number(i, j + 1));
    }
  data.cells.resize(3, static_cast<Index>(cells.size()));
  for (std::size_t c = 0; c < cells.size(); ++c) data.cells.col(static_cast<Index>(c)) = cells[c];
  data.groups = {{"foot", {}}, {"head", {}}};
  for (int i = 0; i < n; ++i) {
    data.groups[0].facets.push_back({number(i, 0), number(i + 1, 0)});
    data.groups[1].facets.push_back({number(i, n), number(i + 1, n)});
  }
  return FineMesh<2>(data);
}

/// Strain energy of the stretched plate with clouds on vertices that all the meshes share.
double compliance(const FineMesh<2>& mesh, const NodeCloud<2>& nodes, const NodeCloud<2>& points,
                  SecondaryKind secondary) {
  Approximation<2> approximation;
  approximation.space = FineSpace<2>(mesh, 1);
  approximation.shape = moving_least_squares(mesh, nodes, {.support = 2.5}).shape;
  approximation.nodes = nodes.positions;
  approximation.node_dofs = nodes.vertices;
  const auto basis = secondary == SecondaryKind::cells
                         ? cell_clusters(approximation.space, points)
                         : secondary_from_table(approximation.space,
                                                moving_least_squares(mesh, points, {.support = 2.0}).shape, points);
  approximation.quadrature = project(approximation.space, approximation.shape, basis);
  const auto pull = [](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return n; };
  return ElasticSolver<2>(approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                          {clamp<2>("foot")})
      .solve({{{"head", pull}}, {}})
      .strain_energy;
}

class MeshQuality : public ::testing::TestWithParam<SecondaryKind> {};

TEST_P(MeshQuality, ComplianceDoesNotFeelSlivers) {
  constexpr int n = 60;
  constexpr double h = 1.0 / n, spacing = 6.0 * h;
  const auto regular = rhombus_with_hole(n, h);
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const auto nodes = sample_cloud(regular, CloudOptions{spacing, seed});
    const auto points =
        sample_cloud(regular, CloudOptions{spacing * (GetParam() == SecondaryKind::cells ? 0.7 : 0.5), seed + 100});
    const auto best = testing::with_split_cells(regular, 1.0);
    EXPECT_NEAR(testing::smallest_angle(best), 30.0, 1e-6);
    const double reference = compliance(best, nodes, points, GetParam());
    for (const double share : {0.3, 0.03, 0.003}) {
      const auto worse = testing::with_split_cells(regular, share);
      const double change = compliance(worse, nodes, points, GetParam()) / reference - 1.0;
      EXPECT_LE(std::abs(change), 1e-3) << "smallest angle " << testing::smallest_angle(worse) << ", cloud " << seed;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Secondary, MeshQuality, ::testing::Values(SecondaryKind::cells, SecondaryKind::mls),
                         [](const auto& test) { return testing::name_of(test.param); });

}  // namespace
}  // namespace efree
