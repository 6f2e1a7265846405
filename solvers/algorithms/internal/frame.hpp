// SPDX-License-Identifier: GPL-3.0-or-later
/// The frame of a unit cell: the box around its mesh, along the axes.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <cmath>

namespace efree::internal {

template <int Dim> struct Frame {
  static constexpr double rounding = 1e-6;  ///< of its lengths: facets this close to a side lie on it
  Vec<Dim> low, lengths;

  explicit Frame(const FineMesh<Dim>& mesh)
      : low(mesh.vertices().rowwise().minCoeff()), lengths(mesh.vertices().rowwise().maxCoeff() - low) {}
  double volume() const { return lengths.prod(); }
  bool is_on(const Vec<Dim>& x) const {
    for (int d = 0; d < Dim; ++d)
      for (const double end : {low[d], low[d] + lengths[d]})
        if (std::abs(x[d] - end) <= rounding * lengths[d]) return true;
    return false;
  }
  /// The side that a boundary facet is on: 2 axis, plus 1 at the upper end; -1: none.
  int side_of(const FineMesh<Dim>& mesh, Index facet) const {
    for (int side = 0; side < 2 * Dim; ++side) {
      const int axis = side / 2;
      const double end = low[axis] + (side % 2) * lengths[axis];
      bool is_on = true;
      for (const Index v : mesh.facets().col(facet))
        is_on = is_on && std::abs(mesh.vertex(v)[axis] - end) <= rounding * lengths[axis];
      if (is_on) return side;
    }
    return -1;
  }
};

}  // namespace efree::internal
