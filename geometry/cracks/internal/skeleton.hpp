// SPDX-License-Identifier: GPL-3.0-or-later
/// Edges and facets of the cells of a mesh, each once.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// Local vertices of a cell's facets, outwards. In space facet i is opposite vertex i; in the plane they are the edges.
template <int Dim> inline constexpr auto facets_of_cell = [] {
  if constexpr (Dim == 2)
    return std::array<std::array<int, 2>, 3>{{{0, 1}, {1, 2}, {2, 0}}};
  else
    return std::array<std::array<int, 3>, 4>{{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};
}();
/// Local vertices of a cell's edges.
template <int Dim> inline constexpr auto edges_of_cell = [] {
  if constexpr (Dim == 2)
    return facets_of_cell<2>;
  else
    return std::array<std::array<int, 2>, 6>{{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};
}();

/// Simplices of K vertices that cells share.
template <int K> struct SharedSimplices {
  std::vector<std::array<Index, K>> vertices;  ///< ascending
  std::vector<int> count;                      ///< of cells that have it
  std::vector<Index> of_cells;                 ///< those of the first cell in its order, then of the next one
};

template <int Dim> struct Skeleton {
  /// Cost n log n.
  explicit Skeleton(const Cells<Dim>& cells);

  SharedSimplices<2> edges;
  SharedSimplices<Dim> facets;  ///< in the plane the edges once more

  Index edge(Index cell, std::size_t i) const { return edges.of_cells[edges_of_cell<Dim>.size() * cell + i]; }
  Index facet(Index cell, std::size_t i) const { return facets.of_cells[(Dim + 1) * cell + i]; }
};

}  // namespace efree::internal
