// SPDX-License-Identifier: GPL-3.0-or-later
/// Domains, bad triangulations and closed forms for the tests of heatgeo.
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/heatgeo/geodesics.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>
#include <random>

namespace efree::testing {

/// [-1, 1]^2 cut along y = 0 from the left side to the origin.
inline FineMesh<2> slit_square(double h) {
  return triangulate(shapes::slit_rectangle(-1, -1, 1, 1, {-1.0, 0.0}, {0.0, 0.0}), {.size = h});
}

/// The same with a point next to the middle of an edge put into every third cell: angles of 0.1 degree.
inline FineMesh<2> with_slivers(const FineMesh<2>& mesh) {
  const double height = 0.5 * std::tan(0.1 * std::numbers::pi / 180.0);
  MeshData<2> data{mesh.vertices(), mesh.cells(), {}};
  const Index cells = mesh.num_cells(), vertices = mesh.num_vertices(), added = (cells + 2) / 3;
  data.vertices.conservativeResize(2, vertices + added);
  data.cells.conservativeResize(3, cells + 2 * added);
  for (Index k = 0; k < added; ++k) {
    const Eigen::Vector3i cell = mesh.cells().col(3 * k);
    const Vec<2> a = mesh.vertex(cell[0]), b = mesh.vertex(cell[1]);
    const Index p = vertices + k;
    data.vertices.col(p) = 0.5 * (a + b) + height * Vec<2>(a.y() - b.y(), b.x() - a.x());
    data.cells.col(3 * k) << cell[0], cell[1], p;
    data.cells.col(cells + 2 * k) << cell[1], cell[2], p;
    data.cells.col(cells + 2 * k + 1) << cell[2], cell[0], p;
  }
  return FineMesh<2>(data);
}

/// Vertex nearest to x; where vertices coincide (on a slit) the one whose cells lie on the side of `towards`.
inline Index vertex_near(const FineMesh<2>& mesh, const Vec<2>& x, const Vec<2>& towards = Vec<2>::Zero()) {
  Index best = -1;
  double least = 1e300;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    Vec<2> star = Vec<2>::Zero();
    for (Index c : mesh.cells_of(v)) star += mesh.centroid(c) - mesh.vertex(v);
    const double distance = (mesh.vertex(v) - x).norm() - 1e-9 * star.dot(towards);
    if (distance < least) {
      least = distance;
      best = v;
    }
  }
  return best;
}

/// -1, 0, 1: below, on the line of, above the x axis; vertices of a slit there belong to the side of their cells.
inline int side_of_axis(const FineMesh<2>& mesh, Index v) {
  const auto sign = [](double y) { return y > 1e-12 ? 1 : y < -1e-12 ? -1 : 0; };
  if (sign(mesh.vertex(v).y()) != 0) return sign(mesh.vertex(v).y());
  int least = 1, most = -1;
  for (Index c : mesh.cells_of(v)) {
    least = std::min(least, sign(mesh.centroid(c).y()));
    most = std::max(most, sign(mesh.centroid(c).y()));
  }
  return least == most ? least : 0;
}

/// Distance in slit_square: straight, or around the tip at the origin.
inline double slit_distance(const FineMesh<2>& mesh, Index a, Index b) {
  const Vec<2> x = mesh.vertex(a), y = mesh.vertex(b);
  const int side_x = side_of_axis(mesh, a), side_y = side_of_axis(mesh, b);
  const double around = x.norm() + y.norm(), straight = (x - y).norm();
  if (side_x * side_y >= 0) return straight;
  const double meets_axis_at =
      (x.x() * std::abs(y.y()) + y.x() * std::abs(x.y())) / (std::abs(x.y()) + std::abs(y.y()));
  if (x.y() == 0.0 && y.y() == 0.0) return around;
  return meets_axis_at >= 0.0 ? straight : around;
}

/// Distance outside a disc of the given radius at the origin: straight, or tangent, arc, tangent.
inline double disc_distance(double radius, const Vec<2>& x, const Vec<2>& y) {
  const double a = std::max(x.norm(), radius), b = std::max(y.norm(), radius);
  const double angle = std::acos(std::clamp(x.dot(y) / (x.norm() * y.norm()), -1.0, 1.0));
  const double arc = angle - std::acos(radius / a) - std::acos(radius / b);
  if (arc <= 0.0) return (x - y).norm();
  return std::sqrt(a * a - radius * radius) + std::sqrt(b * b - radius * radius) + radius * arc;
}

inline std::vector<Index> random_vertices(const FineMesh<2>& mesh, int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<Index> all(mesh.num_vertices());
  for (Index v = 0; v < mesh.num_vertices(); ++v) all[v] = v;
  for (int i = 0; i < count; ++i) std::swap(all[i], all[i + generator() % (all.size() - i)]);
  all.resize(count);
  std::sort(all.begin(), all.end());
  return all;
}

/// Mean and largest |d - exact| / radius over the vertices whose exact distance is below the radius. A vertex that is
/// wrongly reached or not reached counts as an error of 1, but for exact distances within `rim` radii of the radius.
struct DistanceError {
  double mean = 0.0, largest = 0.0;
};

template <class Exact> DistanceError distance_error(const FineMesh<2>& mesh, const Geodesics<2>& geodesics,
                                                    const std::vector<Index>& sources, double radius, double rim,
                                                    const Exact& exact) {
  DistanceError error;
  Index count = 0;
  const auto fields = geodesics.from(sources, Vector::Constant(static_cast<Index>(sources.size()), radius));
  for (std::size_t s = 0; s < sources.size(); ++s) {
    std::vector<double> found(mesh.num_vertices(), -1.0);
    for (std::size_t k = 0; k < fields[s].vertices.size(); ++k) found[fields[s].vertices[k]] = fields[s].values[k];
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const double d = exact(sources[s], v);
      const bool reached = found[v] >= 0.0, in_reach = d < radius;
      if ((!reached && !in_reach) || (reached != in_reach && std::abs(d - radius) < rim * radius)) continue;
      const double e = reached && in_reach ? std::abs(found[v] - d) / radius : 1.0;
      error.mean += e;
      error.largest = std::max(error.largest, e);
      ++count;
    }
  }
  error.mean /= count;
  return error;
}

}  // namespace efree::testing
