// SPDX-License-Identifier: GPL-3.0-or-later
/// Node weights of every engine, and the nearest source.
#include "domains.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gtest/gtest.h>

namespace efree::testing {
namespace {

constexpr Weight all_weights[] = {Weight::heat_geodesic, Weight::heat_flow, Weight::fast_marching, Weight::visibility,
                                  Weight::euclidean};

TEST(NodeWeights, LieInTheUnitIntervalAndReachOneAtTheSource) {
  const FineMesh<2> mesh = slit_square(0.1);
  const auto sources = random_vertices(mesh, 50, 1);
  for (const Weight weight : all_weights)
    for (const Kernel kernel : {Kernel::cubic_spline, Kernel::quintic_spline, Kernel::wendland_c2}) {
      const SparseRows w =
          node_weights(mesh, sources, Vector::Constant(50, 0.45), {.weight = weight, .kernel = kernel});
      ASSERT_EQ(w.rows(), mesh.num_vertices());
      ASSERT_EQ(w.cols(), 50);
      Vector largest = Vector::Zero(50);
      for (Index v = 0; v < w.rows(); ++v) {
        Index last = -1;
        for (SparseRows::InnerIterator it(w, v); it; ++it) {
          EXPECT_GT(it.value(), 0.0);
          EXPECT_LE(it.value(), 1.0);
          EXPECT_GT(it.col(), last) << "columns ascend";
          EXPECT_LT((mesh.vertex(v) - mesh.vertex(sources[it.col()])).norm(), 0.45) << "inside the radius";
          largest[it.col()] = std::max(largest[it.col()], it.value());
          last = it.col();
        }
      }
      for (int s = 0; s < 50; ++s) {
        EXPECT_EQ(largest[s], 1.0);
        if (weight != Weight::heat_flow) {
          EXPECT_EQ(w.coeff(sources[s], s), 1.0);
        }
      }
    }
}

TEST(NodeWeights, AreExactlyZeroBeyondASlitAndReachAroundItsTip) {
  const FineMesh<2> mesh = slit_square(0.06);
  const double radius = 0.4;
  // Far from the tip, on the slit, and so near to the tip that the way around is in reach.
  const std::vector<Index> sources = {vertex_near(mesh, {-0.6, 0.1}), vertex_near(mesh, {-0.6, 0.0}, {0.0, 1.0}),
                                      vertex_near(mesh, {-0.1, 0.1})};
  std::vector<Index> sorted = sources;
  std::sort(sorted.begin(), sorted.end());
  const Index at_tip = static_cast<Index>(std::find(sorted.begin(), sorted.end(), sources[2]) - sorted.begin());
  for (const Weight weight : all_weights) {
    const SparseRows w = node_weights(mesh, sorted, Vector::Constant(3, radius), {.weight = weight});
    int beyond = 0, around = 0;
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      for (SparseRows::InnerIterator it(w, v); it; ++it) {
        if (side_of_axis(mesh, v) >= 0) continue;
        (it.col() == at_tip ? around : beyond) += 1;
      }
    if (weight == Weight::euclidean)
      EXPECT_GT(beyond, 0) << "the straight line sees through";
    else
      EXPECT_EQ(beyond, 0) << static_cast<int>(weight);
    EXPECT_GT(around, 0) << static_cast<int>(weight);
    const Index near_tip = vertex_near(mesh, {0.05, -0.05}), below = vertex_near(mesh, {-0.1, -0.1});
    EXPECT_GT(w.coeff(near_tip, at_tip), 0.1);
    if (weight != Weight::euclidean) {
      EXPECT_LT(w.coeff(below, at_tip), 0.5 * w.coeff(near_tip, at_tip));
    }
  }
}

TEST(NodeWeights, AreBitwiseTheSameOnOneAndTwoThreads) {
  const FineMesh<2> mesh =
      triangulate(shapes::plate_with_random_holes(1.0, 20, 0.03, 0.1, 0.02, 1, 0.02), {.size = 0.03});
  const auto sources = random_vertices(mesh, 100, 1);
  const int before = num_threads();
  for (const Weight weight : all_weights) {
    set_num_threads(1);
    const SparseRows one = node_weights(mesh, sources, Vector::Constant(100, 0.2), {.weight = weight});
    set_num_threads(2);
    const SparseRows two = node_weights(mesh, sources, Vector::Constant(100, 0.2), {.weight = weight});
    ASSERT_EQ(one.nonZeros(), two.nonZeros());
    EXPECT_TRUE(std::equal(one.valuePtr(), one.valuePtr() + one.nonZeros(), two.valuePtr()));
    EXPECT_TRUE(std::equal(one.innerIndexPtr(), one.innerIndexPtr() + one.nonZeros(), two.innerIndexPtr()));
  }
  set_num_threads(before);
}

TEST(HeatFlow, IsASmoothBellThatDoesNotDependOnTheTriangulation) {
  const double radius = 0.8;
  const auto value_at = [&](const FineMesh<2>& mesh, const Vec<2>& x) {
    const Index source = vertex_near(mesh, {0.0, 0.0});
    const LocalField field = std::move(heat_flow_weights(mesh, {source}, Vector::Constant(1, radius)).front());
    const auto at = std::lower_bound(field.vertices.begin(), field.vertices.end(), vertex_near(mesh, x));
    return field.values.at(at - field.vertices.begin());
  };
  MeshData<2> data;
  const auto grid = [&](int n, unsigned flip) {
    data.vertices.resize(2, (n + 1) * (n + 1));
    data.cells.resize(3, 2 * n * n);
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) data.vertices.col(j * (n + 1) + i) << 2.0 * i / n - 1.0, 2.0 * j / n - 1.0;
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const int a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1, k = 2 * (j * n + i);
        if ((i * 7 + j * 3) % 2 == static_cast<int>(flip)) {
          data.cells.col(k) << a, b, c;
          data.cells.col(k + 1) << a, c, d;
        } else {
          data.cells.col(k) << a, b, d;
          data.cells.col(k + 1) << b, c, d;
        }
      }
    return FineMesh<2>(data);
  };
  const FineMesh<2> coarse = grid(40, 0), fine = grid(80, 1), slivers = with_slivers(fine);
  double last = 1.0;
  for (const double x : {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7}) {
    const double w = value_at(fine, {x, 0.0});
    EXPECT_LT(w, last);
    EXPECT_NEAR(value_at(coarse, {x, 0.0}), w, 0.03);
    EXPECT_NEAR(value_at(slivers, {x, 0.0}), w, 0.03);
    last = w;
  }
  EXPECT_NEAR(value_at(fine, {0.4, 0.0}), 0.4, 0.15) << "at half of the radius";
  EXPECT_LT(last, 0.1);
}

TEST(NearestSource, IsTheEuclideanOneInAConvexBody) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.03});
  auto sources = random_vertices(mesh, 60, 2);
  const NearestSource nearest = nearest_source(mesh, sources);
  int different = 0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    double least = 1e300;
    Index best = -1;
    for (std::size_t i = 0; i < sources.size(); ++i)
      if (const double d = (mesh.vertex(v) - mesh.vertex(sources[i])).norm(); d < least) {
        least = d;
        best = static_cast<Index>(i);
      }
    // Where three cells of sources meet inside one triangle the nearest front may be cut off.
    EXPECT_GE(nearest.distance[v], least - 1e-14);
    EXPECT_LE(nearest.distance[v], least + 0.1 * mesh.size());
    different += nearest.source[v] != best && nearest.distance[v] > least + 1e-12;
    EXPECT_NEAR((mesh.vertex(v) - mesh.vertex(sources[nearest.source[v]])).norm(), nearest.distance[v], 1e-12);
  }
  EXPECT_LE(different, mesh.num_vertices() / 1000);
}

TEST(NearestSource, LooksAroundTheSlitAndNotIntoOtherBodies) {
  const FineMesh<2> mesh = slit_square(0.06);
  const std::vector<Index> sources = {vertex_near(mesh, {-0.8, 0.1}), vertex_near(mesh, {-0.5, -0.9})};
  const NearestSource nearest = nearest_source(mesh, sources);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const double d0 = slit_distance(mesh, sources[0], v), d1 = slit_distance(mesh, sources[1], v);
    EXPECT_NEAR(nearest.distance[v], std::min(d0, d1), 1e-3);
    if (std::abs(d0 - d1) > 1e-3) {
      EXPECT_EQ(nearest.source[v], d0 < d1 ? 0 : 1) << mesh.vertex(v).transpose();
    }
  }

  MeshData<2> two{Points<2>(2, 6), Cells<2>(3, 2), {}};
  two.vertices << 0, 1, 0, 5, 6, 5, 0, 0, 1, 0, 0, 1;
  two.cells << 0, 3, 1, 4, 2, 5;
  const FineMesh<2> bodies(two);
  const NearestSource in_first = nearest_source(bodies, {1});
  EXPECT_EQ(in_first.source, (std::vector<Index>{0, 0, 0, -1, -1, -1}));
  EXPECT_EQ(in_first.distance[3], std::numeric_limits<double>::infinity());
  EXPECT_THROW(nearest_source(bodies, {6}), InputError);
}

}  // namespace
}  // namespace efree::testing
