// SPDX-License-Identifier: GPL-3.0-or-later
/// The first triangle on a ray, and the nearest one.
#pragma once

#include "efree/geometry/input/internal/oriented_triangles.hpp"

#include <Eigen/Geometry>
#include <optional>

namespace efree::internal {

/// Triangles in a tree of boxes; a query takes the logarithm of their number. Queries are thread-safe.
class TriangleTree {
 public:
  explicit TriangleTree(std::vector<Triangle> triangles);

  struct Hit {
    double distance;  ///< along the ray [length]
    Index triangle;   ///< in the order in which they were given
  };
  /// The nearest triangle that a ray meets, other than `except`, at least `nearest` and at most `farthest` away.
  /// `direction` has the length 1.
  std::optional<Hit> first_hit(const Vec<3>& from, const Vec<3>& direction, double nearest, double farthest,
                               Index except = -1) const;

  struct Nearest {
    Index triangle;    ///< in the order in which they were given
    Vec<3> weights;    ///< barycentric coordinates of the nearest point in it
    double distance2;  ///< to it, squared
  };
  /// The point of the triangles nearest to x, at most `farthest` away, on one whose normal has a component of more than
  /// one half along `facing` (a unit vector).
  std::optional<Nearest> nearest(const Vec<3>& x, const Vec<3>& facing, double farthest) const;

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    Index begin, end;  ///< its triangles
    Index after;       ///< the node that follows all within this one
  };
  void build(Index begin, Index end);

  std::vector<Triangle> triangles_;
  std::vector<Index> order_;  ///< of the triangles in the leaves
  std::vector<Node> nodes_;   ///< each before those within it
};

}  // namespace efree::internal
