// SPDX-License-Identifier: GPL-3.0-or-later
/// Which nodes of a matrix meet, and which lie together.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/core/types.hpp"

#include <vector>

namespace efree {

/// Nodes with unknowns, numbered anew, and which pairs of them have a block in the matrix: lower triangle by columns.
struct NodeGraph {
  std::vector<Index> first{0};  ///< unknown of each node; one past the last
  std::vector<Index> offsets{0}, rows;
  Index size() const { return static_cast<Index>(first.size()) - 1; }
};
/// `node_of`: the node of each unknown, ascending; empty: every unknown is a node.
NodeGraph node_graph(const SymmetricMatrix& lower, const std::vector<Index>& node_of);

/// Whether every pair of nodes that meet has all of its entries in the matrix, and in the order of `rows`.
bool has_whole_blocks(const SymmetricMatrix& lower, const NodeGraph& graph);

/// Nodes all of whose neighbours are neighbours of another one that has more, as those within the edges of quadratic
/// elements are of both ends: they follow it, and the graph of the others says in which order to eliminate all.
struct Followers {
  std::vector<Index> leaders;           ///< nodes that follow none
  Ragged<Index> followed;               ///< by node: the leaders that it follows, as numbers in `leaders`
  std::vector<Index> offsets{0}, rows;  ///< which leaders meet: lower triangle by columns

  Index size() const { return static_cast<Index>(leaders.size()); }
  /// Whether most nodes follow two, as those of quadratic elements.
  bool are_mostly_between_two() const;
  /// All nodes in the order of the leaders (their numbers), each after those that follow it and none before it.
  std::vector<Index> order(const std::vector<Index>& of_leaders) const;
};
Followers followers(const NodeGraph& graph);

/// Cuts the nodes into clusters of about `size` that lie together: each grows from the node with fewest neighbours left
/// by the one of whose neighbours most belong to it (greedy graph growing; Karypis & Kumar 1998).
std::vector<std::vector<Index>> clusters(const NodeGraph& graph, Index size);

}  // namespace efree
