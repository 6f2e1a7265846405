// SPDX-License-Identifier: GPL-3.0-or-later
/// Symmetric sparse matrices of small dense blocks, stored for fast products.
#pragma once

#include "efree/core/types.hpp"

#include <vector>

namespace efree {

/// Symmetric matrix of Dim x Dim blocks, one row and column for each node. Both triangles are stored: a row then needs
/// nothing but itself, so that products run in parallel and are bitwise the same on any number of threads.
template <int Dim> struct BlockMatrix {
  std::vector<Index> offsets{0};  ///< row i has the entries offsets[i] .. offsets[i+1]
  std::vector<Index> columns;     ///< ascending in each row; the diagonal is always there
  std::vector<Index> diagonal;    ///< entry of each row that is on the diagonal
  std::vector<Mat<Dim>> blocks;   ///< by entry

  Index size() const { return static_cast<Index>(diagonal.size()); }
  /// Entry of block (i, j). Throws std::out_of_range if there is none.
  Index entry(Index i, Index j) const;
  /// y = A x; both Dim x size().
  void multiply(const Points<Dim>& x, Points<Dim>& y) const;
};

}  // namespace efree
