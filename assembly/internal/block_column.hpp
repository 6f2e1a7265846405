// SPDX-License-Identifier: GPL-3.0-or-later
/// The blocks of one node's column of a stiffness while terms are summed into it.
#pragma once

#include "efree/assembly/kinematics.hpp"

#include <span>
#include <vector>

namespace efree::internal {

/// Blocks (b, a) of the column of one node a, for the nodes b >= a that it meets.
template <int Dim> class BlockColumn {
 public:
  explicit BlockColumn(Index nodes) : place_(nodes) {}

  /// Begins a column of zeros.
  void begin(std::span<const Index> nodes) {
    for (std::size_t k = 0; k < nodes.size(); ++k) place_[nodes[k]] = static_cast<Index>(k);
    blocks_.assign(nodes.size(), Mat<Dim>::Zero());
  }
  Mat<Dim>& operator[](Index b) { return blocks_[place_[b]]; }
  Mat<Dim>& at_place(std::size_t k) { return blocks_[k]; }

  /// Adds w G_b^T A G_a, A a stiffness, for the nodes b of a row from the k-th, which is a, on; G are their gradients.
  void add(const ShapeRow<Dim>& row, std::size_t k, double w, const Tangent<Dim>& A);
  /// The same with gradients as they are given, one for each of the nodes, the first of which is a.
  void add(std::span<const Index> nodes, const GradientBlock<Dim>* gradients, double w, const Tangent<Dim>& A);

 private:
  std::vector<Index> place_;  ///< of the column's nodes; of others what was there before
  std::vector<Mat<Dim>, Eigen::aligned_allocator<Mat<Dim>>> blocks_;
};

}  // namespace efree::internal
