// SPDX-License-Identifier: GPL-3.0-or-later
/// Nodes of a block matrix that are not free.
#pragma once

#include "efree/core/types.hpp"

#include <functional>
#include <utility>
#include <vector>

namespace efree {

/// The nodes at which some directions are held, with what is free there.
template <int Dim> class HeldNodes {
 public:
  /// free(node): projector onto the directions that are not held.
  HeldNodes(Index nodes, const std::function<Mat<Dim>(Index)>& free) : index_(nodes, -1) {
    for (Index node = 0; node < nodes; ++node)
      if (const Mat<Dim> open = free(node); open != Mat<Dim>::Identity()) {
        index_[node] = static_cast<Index>(held_.size());
        held_.emplace_back(node, open);
      }
  }
  /// What is free at a node; none if all is.
  const Mat<Dim>* at(Index node) const { return index_[node] < 0 ? nullptr : &held_[index_[node]].second; }
  /// Takes out of x (Dim x nodes) what is held.
  void release(Points<Dim>& x) const {
    for (const auto& [node, open] : held_) x.col(node) = open * Vec<Dim>(x.col(node));
  }

 private:
  std::vector<std::pair<Index, Mat<Dim>>> held_;  ///< nodes ascending
  std::vector<Index> index_;                      ///< by node: into held_, -1 if it is free
};

}  // namespace efree
