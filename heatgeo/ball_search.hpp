// SPDX-License-Identifier: GPL-3.0-or-later
/// Vertices in a ball, wherever the boundary is.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

namespace efree {

/// Regular grid of squares with about eight vertices each. Immutable.
class BallSearch {
 public:
  /// Keeps a reference to the mesh.
  explicit BallSearch(const FineMesh<2>& mesh);
  /// Calls body(v, distance) for every vertex nearer than `radius` to x. Cost linear in their number.
  template <class Body> void for_each(const Vec<2>& x, double radius, const Body& body) const {
    const auto low = square(x.array() - radius), high = square(x.array() + radius);
    for (Index row = low.y(); row <= high.y(); ++row)
      for (Index column = low.x(); column <= high.x(); ++column)
        for (Index v : squares_[row * columns_ + column])
          if (const double distance = (mesh_.vertex(v) - x).norm(); distance < radius) body(v, distance);
  }

 private:
  /// Column and row, clamped to the grid.
  Eigen::Vector2i square(const Vec<2>& x) const;

  const FineMesh<2>& mesh_;
  Vec<2> origin_;
  double width_;
  Index columns_, rows_;
  Ragged<Index> squares_;
};

}  // namespace efree
