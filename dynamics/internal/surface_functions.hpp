// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions on the surface of bodies, by which loads act on nodes.
#pragma once

#include "efree/core/types.hpp"

#include <utility>
#include <vector>

namespace efree::internal {

/// A node near a position.
template <int Dim> struct WeightedNode {
  Index node;
  Vec<Dim> apart;  ///< the node's position less that position, over the spacing
  double weight;   ///< 0 or more
};

/// Values at that position of moving least squares of first order, by node: their sum is 1, and their first moment
/// nothing. Of nodes that lie in a line (plane) constants, whose first moment is that of the weights. None if all
/// weights are zero.
template <int Dim>
std::vector<std::pair<Index, double>> moving_least_squares(const std::vector<WeightedNode<Dim>>& nodes);

/// Appends a row of entries, in any order, to a matrix without rows from that number on.
void append_row(std::vector<std::pair<Index, double>> row, Index number, SparseRows& rows);

}  // namespace efree::internal
