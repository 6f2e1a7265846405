// SPDX-License-Identifier: GPL-3.0-or-later
/// Flat cells out of the way: static condensation of the nodes that only they hold so firmly.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/assembly/internal/finite_elements.hpp"
#include "efree/assembly/internal/gather.hpp"

#include <functional>
#include <vector>

namespace efree {

/// Element nodes in small groups, no two of them coupled by K, such that with these nodes eliminated no flat cell is
/// left that has a height of less than a twentieth of its longest edge: of every such cell one vertex across a small
/// height, with the midpoints of its edges there. Where so many flat cells meet that groups would grow beyond some tens
/// of nodes, or all such vertices are held, some cells stay. Empty if there are none; the same on any number of
/// threads.
template <int Dim> std::vector<std::vector<Index>> flat_groups(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                               const BlockMatrix<Dim>& K,
                                                               const std::function<bool(Index)>& is_free);

/// Some nodes of a symmetric matrix eliminated exactly (Guyan 1965). A flat cell ties its nodes to each other as its
/// length to its height, which point smoothers cannot resolve; of the Schur complement its stiffness is gone.
template <int Dim> class Condensation {
 public:
  /// Puts the Schur complement on the nodes that are in no group in the place of K; rows and columns of the others
  /// become zero. The groups must not be coupled to each other, and K must be positive definite on each.
  Condensation(BlockMatrix<Dim>& K, const std::vector<std::vector<Index>>& groups);

  /// Forces on the nodes left that do as those on all, Dim x K.size(); zero at the others.
  Points<Dim> reduced(Points<Dim> f) const;
  /// Gives the nodes that are eliminated the displacement they have with the others at u, under the forces f on them.
  void follow(const Points<Dim>& f, Points<Dim>& u) const;
  /// a^T K b of the matrix as it was, less that of the Schur complement.
  double work(const Points<Dim>& a, const Points<Dim>& b) const;

 private:
  struct Group {
    std::vector<Index> inner;  ///< its nodes
    std::vector<Index> outer;  ///< those coupled to them
    Matrix own, inverse;       ///< K on the group
    Matrix follow;             ///< inverse times the coupling to `outer`
  };

  std::vector<Group> groups_;
  Ragged<NodePlace> places_;  ///< by node: in `outer` of the groups
};

}  // namespace efree
