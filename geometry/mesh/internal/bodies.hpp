// SPDX-License-Identifier: GPL-3.0-or-later
/// Which vertices hang together by cells.
#pragma once

#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree::internal {

/// By vertex: the first one of its body.
template <int Dim> std::vector<Index> first_of_body(const Cells<Dim>& cells, Index vertices) {
  DisjointSets bodies(vertices);
  for (Index c = 0; c < cells.cols(); ++c)
    for (int i = 1; i <= Dim; ++i) bodies.join(cells(0, c), cells(i, c));
  return std::move(bodies).firsts();
}

}  // namespace efree::internal
