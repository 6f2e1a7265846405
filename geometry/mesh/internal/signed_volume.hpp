// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/LU>

namespace efree::internal {

/// Volume (area in 2D) of a cell, negative if it is turned inside out.
template <int Dim> double signed_volume(const Points<Dim>& x, const Cells<Dim>& cells, Index c) {
  Mat<Dim> edges;
  for (int k = 0; k < Dim; ++k) edges.col(k) = x.col(cells(k + 1, c)) - x.col(cells(0, c));
  return edges.determinant() / (Dim == 2 ? 2.0 : 6.0);
}

}  // namespace efree::internal
