// SPDX-License-Identifier: GPL-3.0-or-later
/// Which vertices hang together by cells.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <algorithm>
#include <numeric>
#include <vector>

namespace efree::internal {

/// By vertex: the smallest one of its body. Trees of vertices, each with its smallest as root (Tarjan 1975).
template <int Dim> std::vector<Index> first_of_body(const Cells<Dim>& cells, Index vertices) {
  std::vector<Index> parent(vertices);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](Index v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (Index c = 0; c < cells.cols(); ++c) {
    const auto cell = cells.col(c);
    // Most cells only say again what is known.
    bool is_known = true;
    for (int i = 1; i <= Dim; ++i) is_known = is_known && parent[cell[i]] == parent[cell[0]];
    if (is_known) continue;
    Index a = root(cell[0]);
    for (int i = 1; i <= Dim; ++i) {
      const Index b = root(cell[i]);
      parent[std::max(a, b)] = std::min(a, b);
      a = std::min(a, b);
    }
  }
  for (Index& v : parent) v = parent[v];  // roots come before what is below them
  return parent;
}

}  // namespace efree::internal
