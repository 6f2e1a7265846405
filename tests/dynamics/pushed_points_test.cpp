// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/contact/internal/pushed_points.hpp"

#include <gtest/gtest.h>

namespace efree::internal {
namespace {

/// A chain of masses whose consistent mass has four terms; points of its surface lie between its first ten nodes. The
/// second node is supported along x.
void make_chain(World<2>& world) {
  constexpr Index N = 30;
  world.nodes.x = Points<2>::Zero(2, N);
  world.nodes.x.row(0).setLinSpaced(0.0, 1.0);
  world.nodes.body.assign(N, 0);
  world.nodes.mass.setZero(N);
  std::vector<Eigen::Triplet<double, Index>> mass, shape;
  for (Index a = 0; a < N; ++a)
    for (Index b = std::max(0, a - 2); b <= std::min(N - 1, a + 2); ++b) {
      const double value = (1.0 + 0.1 * std::sin(a + b)) / (1.0 + std::pow(a - b, 2));
      mass.emplace_back(a, b, value);
      world.nodes.mass[a] += value;
    }
  for (Index s = 0; s < 9; ++s) {
    shape.emplace_back(s, s, 0.3);
    shape.emplace_back(s, s + 1, 0.7);
  }
  world.consistent_mass.terms = {4};
  world.consistent_mass.coupling.resize(N, N);
  world.consistent_mass.coupling.setFromTriplets(mass.begin(), mass.end());
  world.surface_points.shape.resize(9, N);
  world.surface_points.shape.setFromTriplets(shape.begin(), shape.end());
  world.prescribed.push_back({.node = 1, .axis = 0, .velocity = 0.0});
  world.find_free_axes();
}

/// The largest difference of velocities of points 2 to 8 by impulses on these from those of the whole series.
double largest_difference(const World<2>& world, InverseMass<2>& inverse) {
  const std::vector<Index> near{2, 3, 4, 5, 6, 7, 8, 1};
  const PushedPoints<2> pushed(world, inverse, near, Vec<2>(1.0, 0.0));
  Points<2> impulses(2, std::ssize(near)), on_nodes = Points<2>::Zero(2, world.nodes.size());
  for (Index s = 0; s < impulses.cols(); ++s) {
    impulses.col(s) = Vec<2>(std::cos(s), std::sin(3 * s));
    for (SparseRows::InnerIterator entry(world.surface_points.shape, near[s]); entry; ++entry)
      on_nodes.col(entry.col()) += entry.value() * impulses.col(s);
  }
  const Points<2> v = velocities_of(world, Points<2>(world.nodes.free.cwiseProduct(on_nodes)));
  const Points<2> of_points = pushed.velocities(impulses);
  double result = 0.0;
  for (Index s = 0; s < impulses.cols(); ++s)
    result = std::max(result, (of_points.col(s) - row_times<2>(world.surface_points.shape, near[s], v)).norm());
  return result / of_points.colwise().norm().maxCoeff();
}

TEST(PushedPoints, MoveAsTheSeriesOfTheConsistentMassSaysWithSupportsToo) {
  World<2> world;
  make_chain(world);
  InverseMass<2> inverse;
  EXPECT_TRUE(inverse.follow(world));
  EXPECT_LT(largest_difference(world, inverse), 1e-14);
  EXPECT_FALSE(inverse.follow(world));
  world.prescribed.push_back({.node = 5, .axis = 1, .velocity = 0.0});
  world.find_free_axes();
  EXPECT_GT(largest_difference(world, inverse), 1e-3) << "the new support makes no difference";
  EXPECT_TRUE(inverse.follow(world));
  EXPECT_LT(largest_difference(world, inverse), 1e-14);
}

TEST(PushedPoints, BoundsAreAboveTheLargestVelocityOfAnyImpulses) {
  World<2> world;
  make_chain(world);
  InverseMass<2> inverse;
  inverse.follow(world);
  const std::vector<Index> near{2, 3, 4, 5, 6, 7, 8};
  const PushedPoints<1> pushed(world, inverse, near, Vec<2>(0.0, 1.0));
  // In the norm of the bounds the matrix is at most one: power iteration.
  Points<1> impulses = Points<1>::Random(1, pushed.size());
  double largest = 0.0;
  for (int k = 0; k < 200; ++k) {
    const Points<1> v = pushed.velocities(impulses);
    largest = v.cwiseProduct(impulses).sum() / impulses.cwiseAbs2().dot(pushed.bounds().transpose());
    impulses = v.cwiseQuotient(pushed.bounds().transpose());
    impulses.normalize();
  }
  EXPECT_LT(largest, 1.0);
  EXPECT_GT(largest, 0.3);
}

}  // namespace
}  // namespace efree::internal
