// SPDX-License-Identifier: GPL-3.0-or-later
/// Segments and triangles: their nearest point, their normal, and search among many.
#pragma once

#include "efree/basis/internal/neighbours.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree::internal {

/// Weights of the corners in the point of a segment or triangle that is nearest to the origin (Ericson 2005, section
/// 5.1.5).
template <int Dim> Vec<Dim> nearest_in(const Mat<Dim>& corner) {
  if constexpr (Dim == 2) {
    const Vec<2> along = corner.col(1) - corner.col(0);
    const double t = std::clamp(-corner.col(0).dot(along) / along.squaredNorm(), 0.0, 1.0);
    return {1.0 - t, t};
  } else {
    const Vec<3> a = corner.col(0), b = corner.col(1), c = corner.col(2), ab = b - a, ac = c - a;
    const double d1 = -ab.dot(a), d2 = -ac.dot(a);
    if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
    const double d3 = -ab.dot(b), d4 = -ac.dot(b);
    if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0};
    const double d5 = -ab.dot(c), d6 = -ac.dot(c);
    if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)};
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 >= d3 && d5 >= d6) {
      const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
      return {0.0, 1.0 - t, t};
    }
    const double sum = va + vb + vc;
    return {va / sum, vb / sum, vc / sum};
  }
}

/// Outward normal times the area; per unit of depth in the plane.
template <int Dim> Vec<Dim> area_of(const Mat<Dim>& corner) {
  if constexpr (Dim == 2) {
    const Vec<2> along = corner.col(1) - corner.col(0);
    return {along[1], -along[0]};
  } else {
    return 0.5 * Vec<3>(corner.col(1) - corner.col(0)).cross(Vec<3>(corner.col(2) - corner.col(0)));
  }
}

/// Weights of the corners in the point of the line or plane of a facet that is nearest to the origin; negative ones
/// beyond its edges.
template <int Dim> Vec<Dim> weights_in(const Mat<Dim>& corner) {
  if constexpr (Dim == 2) {
    const Vec<2> along = corner.col(1) - corner.col(0);
    const double t = -corner.col(0).dot(along) / along.squaredNorm();
    return {1.0 - t, t};
  } else {
    const Vec<3> area = area_of<3>(corner), per_area = 0.5 * area / area.squaredNorm();
    const auto opposite = [&](int i) { return per_area.dot(corner.col((i + 1) % 3).cross(corner.col((i + 2) % 3))); };
    return {opposite(0), opposite(1), opposite(2)};
  }
}

/// Positions of a facet's nodes.
template <int Dim> Mat<Dim> facet_corners(const Points<Dim>& x, const Facets<Dim>& facets, Index f) {
  return x(Eigen::all, facets.col(f));
}

/// Facets in a tree by their centres.
template <int Dim> struct FacetTree {
  Neighbours<Dim> centres{};
  double reach = 0.0;  ///< largest distance of a corner from the centre of its facet

  FacetTree(const Points<Dim>& x, const Facets<Dim>& facets) {
    Points<Dim> centre(Dim, facets.cols());
    for (Index f = 0; f < facets.cols(); ++f) {
      const Mat<Dim> corner = facet_corners(x, facets, f);
      centre.col(f) = corner.rowwise().mean();
      reach = std::max(reach, std::sqrt((corner.colwise() - centre.col(f)).colwise().squaredNorm().maxCoeff()));
    }
    centres.build(centre);
  }
};

/// The facet of a surface that is nearest to the origin. Of facets that share the nearest point the one that faces the
/// origin most decides on which side of the surface the origin is.
template <int Dim> class NearestFacet {
 public:
  /// Distances that differ by less than `slack` are the same; facets no larger than `collapsed` are ignored.
  explicit NearestFacet(double slack, double collapsed = 0.0) : slack_(slack), collapsed_(collapsed) {}

  /// Compares with the next facet, of these corners.
  void compare(Index facet, const Mat<Dim>& corner) {
    const Vec<Dim> area = area_of<Dim>(corner);
    if (!(area.norm() > collapsed_)) return;
    const Vec<Dim> weights = nearest_in<Dim>(corner), point = corner * weights;
    const double distance = point.norm();
    const double faces = distance > 0.0 ? point.dot(area) / (area.norm() * distance) : 0.0;
    if (distance > distance_ + slack_ || (distance > distance_ - slack_ && std::abs(faces) <= std::abs(facing_)))
      return;
    distance_ = std::min(distance_, distance);
    facing_ = faces;
    facet_ = facet;
    weights_ = weights;
    to_ = point;
  }

  Index facet() const { return facet_; }  ///< -1: none so far
  const Vec<Dim>& weights() const { return weights_; }
  const Vec<Dim>& to() const { return to_; }  ///< the nearest point
  double distance() const { return distance_; }
  bool is_inside() const { return facing_ > 0.0; }

 private:
  double slack_, collapsed_, distance_ = std::numeric_limits<double>::infinity(), facing_ = 0.0;
  Index facet_ = -1;
  Vec<Dim> weights_ = Vec<Dim>::Zero(), to_ = Vec<Dim>::Zero();
};

}  // namespace efree::internal
