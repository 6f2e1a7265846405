// SPDX-License-Identifier: GPL-3.0-or-later
/// Which components of nodal displacements are unknown.
#pragma once

#include "efree/assembly/nodal_conditions.hpp"

#include <vector>

namespace efree::internal {

/// Components of the displacements of nodes, in frames of their own where conditions fix some of them, and the numbers
/// of those that are unknown. Degree of freedom = Dim * node + component.
template <int Dim> class Unknowns {
 public:
  /// All components of all nodes but those that are fixed.
  Unknowns(Index nodes, NodalConditions<Dim> conditions);

  Index num_nodes() const { return num_nodes_; }
  Index size() const { return size_; }
  /// Number of a component (of the node's frame) among the unknowns; -1 if it is fixed.
  Index operator()(Index node, int component) const {
    return number_.empty() ? Dim * node + component : number_[Dim * node + component];
  }
  /// The node's frame; nullptr for the axes.
  const Mat<Dim>* frame(Index node) const {
    return frame_at_.empty() || frame_at_[node] < 0 ? nullptr : &conditions_.frames[frame_at_[node]];
  }
  /// The node of each unknown; ascending.
  const std::vector<Index>& node_of() const { return node_of_; }

  /// What forces on the nodes (Dim x nodes) are along the unknowns.
  Vector of(const Points<Dim>& forces) const;
  /// Displacements of the nodes by the unknowns; the fixed components are zero.
  Points<Dim> to_nodes(const Vector& values) const;
  /// Displacements whose fixed components are `factor` times what is prescribed, and the others as they are.
  Points<Dim> prescribe(double factor, Points<Dim> displacements) const;
  /// The fixed components of displacements; the others are zero.
  Points<Dim> fixed_part(const Points<Dim>& displacements) const;

 private:
  Index num_nodes_, size_ = 0;
  NodalConditions<Dim> conditions_;
  std::vector<Index> number_;    ///< empty if all are unknown
  std::vector<Index> frame_at_;  ///< by node: place in conditions_, -1 for the axes; empty if all are
  std::vector<Index> node_of_;
};

}  // namespace efree::internal
