// SPDX-License-Identifier: GPL-3.0-or-later
/// Cells with cuts as the pieces of their vertices.
#pragma once

#include "efree/geometry/cracks/internal/crack_middles.hpp"

namespace efree::internal {

/// Cells of nodes, and their surface.
template <int Dim> struct Pieces {
  std::vector<std::array<Index, Dim + 1>> cells;  ///< positive
  std::vector<Index> vertex;                      ///< by cell: one of the vertices whose piece it is of
  std::vector<std::array<Index, Dim>> surface;    ///< facets, outwards
  std::vector<char> is_crack;                     ///< by facet: whether it is the face of a crack
};
/// Cells without a cut stay as they are. Of others each face is cut as its own edges say, so that neighbours agree.
template <int Dim> Pieces<Dim> cut_into_pieces(const Cells<Dim>& cells, const Skeleton<Dim>& skeleton,
                                               const CrackMiddles<Dim>& middles, Index vertices);

}  // namespace efree::internal
