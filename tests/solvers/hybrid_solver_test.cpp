// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/hybrid_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/solvers/linear/internal/node_graph.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

namespace efree {
namespace {

struct System {
  SymmetricMatrix lower;
  std::vector<Index> node_of;
};
/// Points of a lattice on springs to all others within a radius, whose coefficients are those of functions as wide:
/// what clouds in space are like. The whole stands on springs of this stiffness.
System lattice(Index side, double radius, double ground) {
  const Index nodes = side * side * side;
  const auto place = [&](Index a) {
    const Index i = a % side, j = a / side % side, k = a / (side * side);
    return Vec<3>(i, j, k);
  };
  std::vector<Eigen::Triplet<double>> entries;
  System system;
  for (Index a = 0; a < nodes; ++a) {
    for (int d = 0; d < 3; ++d) system.node_of.push_back(a);
    Mat<3> own = ground * Mat<3>::Identity();
    for (Index b = 0; b < nodes; ++b) {
      const Vec<3> along = place(b) - place(a);
      const double length = along.norm();
      if (a == b || length > radius) continue;
      const Mat<3> spring = std::exp(-length) * along * along.transpose() / (length * length);
      own += spring;
      if (b < a) continue;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) entries.emplace_back(3 * b + i, 3 * a + j, -spring(i, j));
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) entries.emplace_back(3 * a + i, 3 * a + j, own(i, j));
  }
  system.lower.resize(3 * nodes, 3 * nodes);
  system.lower.setFromTriplets(entries.begin(), entries.end());
  return system;
}

Vector load(Index size) {
  Vector b(size);
  for (Index i = 0; i < size; ++i) b[i] = std::sin(1.0 + 0.37 * i);
  return b;
}

double left(const SymmetricMatrix& lower, const Vector& x, const Vector& b) {
  return (lower.selfadjointView<Eigen::Lower>() * x - b).norm() / b.norm();
}

TEST(HybridSolver, SolvesWithoutAFactorWhatIsNearlyFullAndSaysThatItIsStable) {
  const auto [lower, node_of] = lattice(12, 3.0, 0.01);
  HybridSolver solver;
  solver.analyse(lower, node_of);
  solver.factorize(lower);
  const Vector b = load(static_cast<Index>(lower.rows()));
  const Vector x = solver.solve(b);
  EXPECT_LT(left(lower, x, b), HybridSolver::tolerance);
  EXPECT_EQ(solver.negative_pivots(), 0);
  EXPECT_FALSE(solver.has_factor());
  const Vector exact = Cholesky(lower, node_of).solve(b);
  EXPECT_LT((x - exact).norm(), 1e-5 * exact.norm());
  // In other units.
  SymmetricMatrix scaled = 1e60 * lower;
  solver.factorize(scaled);
  EXPECT_LT((1e60 * Vector(solver.solve(b)) - x).norm(), 1e-6 * x.norm());
  EXPECT_FALSE(solver.has_factor());
}

TEST(HybridSolver, HasTheSameBitsOnAnyNumberOfThreads) {
  const auto [lower, node_of] = lattice(12, 3.0, 0.01);
  const Vector b = load(static_cast<Index>(lower.rows()));
  std::vector<Vector> found;
  const int before = num_threads();
  for (const int threads : {1, 2, 3}) {
    set_num_threads(threads);
    HybridSolver solver;
    solver.analyse(lower, node_of);
    solver.factorize(lower);
    found.emplace_back(solver.solve(b));
    EXPECT_FALSE(solver.has_factor());
  }
  set_num_threads(before);
  EXPECT_EQ(found[1], found[0]);
  EXPECT_EQ(found[2], found[0]);
}

/// Conjugate gradients do not hide instabilities: where they meet one, or do not come to their end, the factor counts.
TEST(HybridSolver, CountsNegativeEigenvaluesByTheFactor) {
  auto [lower, node_of] = lattice(12, 3.0, 0.01);
  HybridSolver solver;
  solver.analyse(lower, node_of);
  // The six motions of the whole have 0.01, and none has less.
  SymmetricMatrix unstable = lower;
  for (Index i = 0; i < unstable.rows(); ++i) unstable.coeffRef(i, i) -= 0.01 + 1e-5;
  solver.factorize(unstable);
  EXPECT_EQ(solver.negative_pivots(), 6);
  EXPECT_TRUE(solver.has_factor());
  const Vector b = load(static_cast<Index>(lower.rows()));
  EXPECT_LT(left(unstable, solver.solve(b), b), 1e-8);
  // And the next matrix is solved without again.
  solver.factorize(lower);
  EXPECT_EQ(solver.negative_pivots(), 0);
  EXPECT_FALSE(solver.has_factor());
}

TEST(HybridSolver, FactorsWhatIsSparse) {
  const auto [lower, node_of] = lattice(6, 1.5, 0.01);
  HybridSolver solver;
  solver.analyse(lower, node_of);
  solver.factorize(lower);
  EXPECT_TRUE(solver.has_factor());
  const Vector b = load(static_cast<Index>(lower.rows()));
  EXPECT_EQ(Vector(solver.solve(b)), Vector(Cholesky(lower, node_of).solve(b))) << "bit for bit";
}

TEST(HybridSolver, RefusesAnotherPatternAndAnotherSize) {
  const auto [lower, node_of] = lattice(12, 3.0, 0.01);
  HybridSolver solver;
  solver.analyse(lower, node_of);
  EXPECT_THROW(solver.factorize(lattice(12, 2.0, 0.01).lower), InputError);
  solver.factorize(lower);
  EXPECT_THROW(solver.solve(Vector::Ones(7)), InputError);
}

TEST(NodeGraph, ClustersLieTogetherAndHoldEveryNodeOnce) {
  const auto [lower, node_of] = lattice(8, 2.0, 0.01);
  std::set<Index> seen;
  for (const auto& cluster : clusters(node_graph(lower, node_of), 32)) {
    EXPECT_LE(cluster.size(), 32u);
    Points<3> places(3, cluster.size());
    for (std::size_t k = 0; k < cluster.size(); ++k) {
      EXPECT_TRUE(seen.insert(cluster[k]).second);
      const Index x = cluster[k] % 8, y = cluster[k] / 8 % 8, z = cluster[k] / 64;
      places.col(static_cast<Index>(k)) << x, y, z;
    }
    // A ball of 32 has a radius of gyration of 1.5, all of the lattice has 4; what is left at last is long.
    const Points<3> off = places.colwise() - places.rowwise().mean();
    EXPECT_LT(std::sqrt(off.colwise().squaredNorm().mean()), 3.0);
  }
  EXPECT_EQ(seen.size(), 512u);
}

/// The graph of a problem that nothing holds.
NodeGraph graph_of(const FineMesh<2>& mesh, const ApproximationOptions& options) {
  const auto approximation = approximate(mesh, options);
  std::vector<Index> node_of;
  for (Index node = 0; node < approximation.shape.num_nodes(); ++node) node_of.insert(node_of.end(), 2, node);
  const Materials<2> materials({LinearElastic(1.0, 0.3)}, Plane::strain);
  return node_graph(stiffness_matrix(approximation.quadrature, materials.tangents(approximation.quadrature)), node_of);
}

TEST(NodeGraph, NodesOnEdgesOfQuadraticElementsFollowTheEnds) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 1.0), {.size = 0.1});
  const Index vertices = mesh.num_vertices();
  const NodeGraph graph = graph_of(mesh, {.kind = BasisKind::p2});
  const Followers all = followers(graph);
  EXPECT_TRUE(all.are_mostly_between_two());
  for (const Index leader : all.leaders) EXPECT_LT(leader, vertices);
  const auto edges = FineSpace<2>(mesh, 2).edges();
  for (Index dof = vertices; dof < graph.size(); ++dof)
    for (const Index end : edges[dof - vertices])
      if (const auto at = std::ranges::find(all.leaders, end); at != all.leaders.end()) {
        EXPECT_EQ(std::ranges::count(all.followed[dof], at - all.leaders.begin()), 1) << dof;
      }

  std::vector<Index> backwards(all.leaders.size());
  for (Index k = 0; k < all.size(); ++k) backwards[k] = all.size() - 1 - k;
  const std::vector<Index> order = all.order(backwards);
  ASSERT_EQ(std::ssize(order), graph.size());
  std::vector<Index> rank(order.size(), -1);
  for (std::size_t k = 0; k < order.size(); ++k) rank[order[k]] = static_cast<Index>(k);
  EXPECT_EQ(std::ranges::count(rank, -1), 0) << "all are there";
  for (Index k = 1; k < all.size(); ++k) EXPECT_LT(rank[all.leaders[k]], rank[all.leaders[k - 1]]);
  for (Index node = 0; node < graph.size(); ++node)
    for (const Index leader : all.followed[node]) EXPECT_LT(rank[node], rank[all.leaders[leader]]);

  EXPECT_FALSE(followers(graph_of(mesh, {.kind = BasisKind::p1})).are_mostly_between_two());
  EXPECT_FALSE(followers(graph_of(mesh, {.spacing = 0.25})).are_mostly_between_two());
}

}  // namespace
}  // namespace efree
