// SPDX-License-Identifier: GPL-3.0-or-later
/// Distances and weights in space.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/heatgeo/marching_3d.hpp"
#include "efree/tests/solids.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

constexpr Index n = 10;

Index vertex_near(const FineMesh<3>& mesh, const Vec<3>& x) {
  Index best = 0;
  for (Index v = 1; v < mesh.num_vertices(); ++v)
    if ((mesh.vertex(v) - x).squaredNorm() < (mesh.vertex(best) - x).squaredNorm()) best = v;
  return best;
}

/// Exact distance in the box with a slit x = 1/2, z <= tip, for points on either side: the straight line, or around the
/// tip after turning one side about it.
double around_slit(const Vec<3>& a, const Vec<3>& b, double tip) {
  const double side = (a.x() - 0.5) * (b.x() - 0.5);
  const double share = (0.5 - a.x()) / (b.x() - a.x());
  if (side >= 0.0 || a.z() + share * (b.z() - a.z()) >= tip) return (a - b).norm();
  const double radii =
      Eigen::Vector2d(a.x() - 0.5, a.z() - tip).norm() + Eigen::Vector2d(b.x() - 0.5, b.z() - tip).norm();
  return Eigen::Vector2d(radii, a.y() - b.y()).norm();
}

double tip_of(const FineMesh<3>& mesh) {
  double tip = 0.0;
  for (Index f : mesh.group("slit"))
    for (Index v : mesh.facets().col(f)) tip = std::max(tip, mesh.vertex(v).z());
  return tip;
}

/// Mean and largest error over all vertices nearer than `radius` whose copies on the slit are no question.
std::pair<double, double> errors(const FineMesh<3>& mesh, Index source, double radius, Weight engine) {
  const LocalField field = Geodesics<3>(mesh, {.engine = engine}).from(source, radius);
  const double tip = tip_of(mesh);
  double sum = 0.0, worst = 0.0;
  Index count = 0;
  for (std::size_t k = 0; k < field.vertices.size(); ++k) {
    const Vec<3> x = mesh.vertex(field.vertices[k]);
    if (x.x() == 0.5) continue;
    const double error = std::abs(field.values[k] - around_slit(mesh.vertex(source), x, tip));
    sum += error, ++count;
    worst = std::max(worst, error);
  }
  return {sum / count / radius, worst / radius};
}

TEST(SolidGeodesics, StraightLinesInAConvexBodyAreExact) {
  const FineMesh<3> mesh = testing::with_sides(testing::box(n));
  const Index source = vertex_near(mesh, {0.2, 0.3, 0.4});
  for (const Weight engine : {Weight::automatic, Weight::fast_marching, Weight::euclidean})
    for (const bool always : {false, true}) {
      const LocalField field = Geodesics<3>(mesh, {.engine = engine, .always_solve = always}).from(source, 0.6);
      Index within = 0;
      for (Index v = 0; v < mesh.num_vertices(); ++v) within += (mesh.vertex(v) - mesh.vertex(source)).norm() < 0.6;
      EXPECT_EQ(static_cast<Index>(field.vertices.size()), within);
      for (std::size_t k = 0; k < field.vertices.size(); ++k)
        EXPECT_NEAR(field.values[k], (mesh.vertex(field.vertices[k]) - mesh.vertex(source)).norm(), 1e-12);
    }
}

TEST(SolidGeodesics, PathsBendAroundTheTipOfASlit) {
  const FineMesh<3> mesh = testing::slit_box(n);
  const Index source = vertex_near(mesh, {0.3, 0.5, 0.3});
  const auto [marching_mean, marching_worst] = errors(mesh, source, 0.7, Weight::fast_marching);
  EXPECT_LT(marching_mean, 0.002);
  EXPECT_LT(marching_worst, 0.02);
  const auto [heat_mean, heat_worst] = errors(mesh, source, 0.7, Weight::heat_geodesic);
  EXPECT_LT(heat_mean, 0.05);
  EXPECT_LT(heat_worst, 0.2);
  EXPECT_GT(errors(mesh, source, 0.7, Weight::euclidean).first, 0.02);  // what it would be through the slit
}

TEST(SolidGeodesics, WeightsOfTheOtherSideAreZeroAwayFromTheTip) {
  const FineMesh<3> mesh = testing::slit_box(n);
  const Index source = vertex_near(mesh, {0.4, 0.5, 0.1});
  for (const Weight weight : {Weight::fast_marching, Weight::heat_geodesic, Weight::heat_flow}) {
    const SparseRows weights = node_weights(mesh, {source}, Vector::Constant(1, 0.3), {.weight = weight});
    EXPECT_GT(weights.nonZeros(), 20);
    for (Index v = 0; v < mesh.num_vertices(); ++v)
      if (weights.coeff(v, 0) != 0.0) {
        EXPECT_LE(mesh.vertex(v).x(), 0.5 + 1e-12);
        EXPECT_GT(weights.coeff(v, 0), 0.0);
        EXPECT_LE(weights.coeff(v, 0), 1.0 + 1e-12);
      }
  }
}

/// Around a ball the path is two tangents and an arc.
TEST(SolidGeodesics, PathsGoAroundAHoleInTheMesh) {
  MeshData<3> data = testing::box(16, 0.0);
  // Carve the cells around the middle of the box.
  std::vector<Index> kept;
  for (Index c = 0; c < data.cells.cols(); ++c) {
    Vec<3> centre = Vec<3>::Zero();
    for (int i = 0; i < 4; ++i) centre += 0.25 * data.vertices.col(data.cells(i, c));
    if ((centre - Vec<3>::Constant(0.5)).norm() > 0.25) kept.push_back(c);
  }
  data.cells = data.cells(Eigen::all, kept).eval();
  const FineMesh<3> mesh(data);
  const Index source = vertex_near(mesh, {0.125, 0.5, 0.5}), target = vertex_near(mesh, {0.875, 0.5, 0.5});
  const LocalField field = Geodesics<3>(mesh, {.engine = Weight::fast_marching}).from(source, 2.0);
  ASSERT_EQ(static_cast<Index>(field.vertices.size()), mesh.num_vertices());
  const double radius = 0.25, reach = 0.375, tangent = std::sqrt(reach * reach - radius * radius);
  const double exact = 2.0 * tangent + radius * (std::numbers::pi - 2.0 * std::acos(radius / reach));
  EXPECT_NEAR(field.values[target], exact, 0.1 * exact);
  for (std::size_t k = 0; k < field.vertices.size(); ++k)
    EXPECT_GE(field.values[k], (mesh.vertex(field.vertices[k]) - mesh.vertex(source)).norm() - 1e-12);
}

TEST(SolidGeodesics, NearestSourcesAgreeWithSingleOnes) {
  const FineMesh<3> mesh = testing::slit_box(n);
  const std::vector<Index> sources{vertex_near(mesh, {0.2, 0.2, 0.2}), vertex_near(mesh, {0.8, 0.7, 0.2}),
                                   vertex_near(mesh, {0.4, 0.8, 0.9})};
  const NearestSource nearest = nearest_source(mesh, sources);
  const auto fields = Geodesics<3>(mesh, {.engine = Weight::fast_marching}).from(sources, Vector::Constant(3, 4.0));
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    double least = 1e300;
    for (const auto& field : fields) {
      ASSERT_EQ(static_cast<Index>(field.vertices.size()), mesh.num_vertices());
      least = std::min(least, field.values[v]);
    }
    EXPECT_NEAR(nearest.distance[v], least, 0.02);
  }
}

TEST(SolidGeodesics, OneAndTwoThreadsGiveTheSameBits) {
  const FineMesh<3> mesh = testing::slit_box(n);
  std::vector<Index> sources;
  for (Index v = 0; v < mesh.num_vertices(); v += 37) sources.push_back(v);
  const Vector radii = Vector::Constant(static_cast<Index>(sources.size()), 0.4);
  for (const Weight weight : {Weight::automatic, Weight::heat_geodesic, Weight::heat_flow}) {
    set_num_threads(1);
    const SparseRows one = node_weights(mesh, sources, radii, {.weight = weight});
    set_num_threads(2);
    const SparseRows two = node_weights(mesh, sources, radii, {.weight = weight});
    ASSERT_EQ(one.nonZeros(), two.nonZeros());
    for (Index k = 0; k < one.nonZeros(); ++k) ASSERT_EQ(one.valuePtr()[k], two.valuePtr()[k]);
  }
}

TEST(SolidGeodesics, VisibilityIsForThePlane) {
  const FineMesh<3> mesh = testing::with_sides(testing::box(2));
  EXPECT_THROW(Geodesics<3>(mesh, {.engine = Weight::visibility}), InputError);
}

}  // namespace
}  // namespace efree
