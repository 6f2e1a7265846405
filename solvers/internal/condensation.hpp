// SPDX-License-Identifier: GPL-3.0-or-later
/// Flat cells out of the way: static condensation of the nodes that only they hold so firmly.
#pragma once

#include "efree/assembly/block_matrix.hpp"
#include "efree/assembly/finite_elements.hpp"

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
  /// The groups must not be coupled to each other, and K must be positive definite on each.
  Condensation(const BlockMatrix<Dim>& K, const std::vector<std::vector<Index>>& groups);

  /// Nodes that are left, ascending.
  const std::vector<Index>& kept() const { return kept_; }
  /// Schur complement on them.
  const BlockMatrix<Dim>& matrix() const { return matrix_; }
  /// Forces on the nodes left that do as those on all: Dim x K.size() to Dim x kept().size().
  Points<Dim> restrict(const Points<Dim>& r) const;
  /// Displacement of all nodes with those left at z and no force but r on the others.
  Points<Dim> extend(const Points<Dim>& z, const Points<Dim>& r) const;

 private:
  struct Group {
    std::vector<Index> inner;  ///< its nodes
    std::vector<Index> outer;  ///< those coupled to them, as kept
    Matrix inverse;            ///< of K on the group
    Matrix follow;             ///< inverse times the coupling to `outer`
  };
  struct Place {
    Index group, position;  ///< of a kept node in `outer`
  };

  std::vector<Index> kept_;
  std::vector<Group> groups_;
  Ragged<Place> places_;  ///< by kept node
  BlockMatrix<Dim> matrix_;
};

}  // namespace efree
