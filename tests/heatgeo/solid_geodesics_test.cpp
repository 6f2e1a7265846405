// SPDX-License-Identifier: GPL-3.0-or-later
/// Distances and weights in space.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/heatgeo/geodesics.hpp"
#include "efree/heatgeo/internal/marching_3d.hpp"
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

/// The box with a cube of cells cut out of its middle, lattice or not: many lines pass through edges and vertices of
/// the hole, or along its sides.
FineMesh<3> box_with_hole(double jitter) {
  MeshData<3> data = testing::box(12, jitter);
  std::vector<Index> kept;
  for (Index c = 0; c < data.cells.cols(); ++c) {
    Vec<3> centre = Vec<3>::Zero();
    for (int i = 0; i < 4; ++i) centre += 0.25 * data.vertices.col(data.cells(i, c));
    if ((centre - Vec<3>::Constant(0.5)).cwiseAbs().maxCoeff() > 0.25) kept.push_back(c);
  }
  data.cells = data.cells(Eigen::all, kept).eval();
  return FineMesh<3>(data);
}

/// Where the open segment meets the plane of a facet: the smallest barycentric coordinate, or -1 where it does not.
double passes_through(const FineMesh<3>& mesh, Index f, const Vec<3>& p, const Vec<3>& q) {
  const Vec<3> a = mesh.vertex(mesh.facets()(0, f)), b = mesh.vertex(mesh.facets()(1, f)) - a,
               c = mesh.vertex(mesh.facets()(2, f)) - a, normal = b.cross(c);
  const double from = normal.dot(p - a), to = normal.dot(q - a), t = from / (from - to);
  if (std::max(std::abs(from), std::abs(to)) < 1e-12 || !(t > 1e-9 && t < 1.0 - 1e-9)) return -1.0;
  const Vec<3> x = p + t * (q - p) - a;
  const double u = normal.dot(b.cross(x)) / normal.squaredNorm(), v = normal.dot(x.cross(c)) / normal.squaredNorm();
  return std::min({u, v, 1.0 - u - v});
}

/// Against every facet in turn: a line that stays clear of all of them, or ends at its own, is the distance; through
/// the inside of one, the distance is longer.
TEST(SolidGeodesics, DistancesAreStraightWhereNoFacetIsInTheWayAndLongerBehindOne) {
  for (const FineMesh<3>& mesh : {box_with_hole(0.0), box_with_hole(0.2), testing::slit_box(n)}) {
    std::vector<Index> sources;
    for (Index v = 11; v < mesh.num_vertices(); v += 311) sources.push_back(v);
    const double radius = 0.8;
    const auto fields = Geodesics<3>(mesh, {.engine = Weight::fast_marching})
                            .from(sources, Vector::Constant(static_cast<Index>(sources.size()), radius));
    Index clear = 0, behind = 0;
    for (std::size_t i = 0; i < sources.size(); ++i) {
      std::vector<double> distance(mesh.num_vertices(), radius);
      for (std::size_t k = 0; k < fields[i].vertices.size(); ++k) distance[fields[i].vertices[k]] = fields[i].values[k];
      const Vec<3> x = mesh.vertex(sources[i]);
      for (Index v = 0; v < mesh.num_vertices(); ++v) {
        const Vec<3> y = mesh.vertex(v);
        const double straight = (y - x).norm();
        if (straight >= radius || straight == 0.0) continue;
        double deepest = -1.0;
        for (Index f = 0; f < mesh.num_facets(); ++f) deepest = std::max(deepest, passes_through(mesh, f, x, y));
        const bool ends_on_boundary = mesh.on_boundary(v) || mesh.on_boundary(sources[i]);
        if (deepest > 1e-6) {
          EXPECT_GT(distance[v], straight) << "from " << x.transpose() << " to " << y.transpose();
          ++behind;
        } else if (deepest < -1e-6 && !ends_on_boundary) {
          EXPECT_NEAR(distance[v], straight, 1e-12) << "from " << x.transpose() << " to " << y.transpose();
          ++clear;
        }
        EXPECT_GE(distance[v], straight - 1e-12);
      }
    }
    EXPECT_GT(clear, 100);
    EXPECT_GT(behind, 100);
  }
}

/// Largest error anywhere around a spherical cavity: straight, or tangent, arc, tangent.
TEST(SolidGeodesics, PathsAroundASphereAreLongerByOnePerCentInTheMean) {
  const FineMesh<3> mesh(solids::spherical_cavity(1.0, 2.0, 0.2));
  std::vector<Index> sources;
  for (Index v = 0; v < mesh.num_vertices(); v += 97) sources.push_back(v);
  const double radius = 1.5;
  const auto fields = Geodesics<3>(mesh, {.engine = Weight::fast_marching})
                          .from(sources, Vector::Constant(static_cast<Index>(sources.size()), radius));
  double longest = 0.0, shortest = 0.0, sum = 0.0;
  Index behind = 0;
  for (std::size_t i = 0; i < sources.size(); ++i)
    for (std::size_t k = 0; k < fields[i].vertices.size(); ++k) {
      const Vec<3> x = mesh.vertex(sources[i]), y = mesh.vertex(fields[i].vertices[k]);
      const double a = std::max(x.norm(), 1.0), b = std::max(y.norm(), 1.0);
      const double angle = std::acos(std::clamp(x.dot(y) / (x.norm() * y.norm()), -1.0, 1.0));
      const double arc = angle - std::acos(1.0 / a) - std::acos(1.0 / b);
      if (arc <= 0.01) continue;  // the mesh's sphere has flat facets
      const double error = (fields[i].values[k] - (std::sqrt(a * a - 1.0) + std::sqrt(b * b - 1.0) + arc)) / radius;
      longest = std::max(longest, error);
      shortest = std::min(shortest, error);
      sum += std::abs(error);
      ++behind;
    }
  EXPECT_GT(behind, 1000);
  EXPECT_LT(sum / behind, 0.01);
  EXPECT_LT(longest, 0.06);
  EXPECT_GT(shortest, -0.001);
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
