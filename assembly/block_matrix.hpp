// SPDX-License-Identifier: GPL-3.0-or-later
/// Symmetric sparse matrices of small dense blocks, stored for fast products.
#pragma once

#include "efree/core/types.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace efree {

/// Symmetric matrix of Dim x Dim blocks, one row and column for each node. Both triangles are stored: a row then needs
/// nothing but itself, so that products run in parallel and are bitwise the same on any number of threads. Rows lie in
/// chunks of their own, so that a matrix can be made, and remade, without room for a second one.
template <int Dim> struct BlockMatrix {
  static constexpr Index chunk_rows = 8192;
  /// Consecutive rows: all have `chunk_rows` but the last.
  struct Chunk {
    std::vector<Index> offsets{0};  ///< row r of the chunk has the entries offsets[r] .. offsets[r+1]
    std::vector<Index> columns;     ///< ascending in each row; the diagonal is always there
    std::vector<Index> diagonal;    ///< entry of each row that is on the diagonal
    std::vector<Mat<Dim>> blocks;   ///< by entry

    Index rows() const { return static_cast<Index>(diagonal.size()); }
    /// Ends the row of this number in the matrix: its entries are those beyond the row before.
    void close_row(Index number);
  };
  struct Row {
    std::span<const Index> columns;
    std::span<const Mat<Dim>> blocks;
    Index diagonal;  ///< place of the diagonal among them
  };
  std::vector<Chunk> chunks;

  Index size() const {
    return chunks.empty() ? 0 : static_cast<Index>(chunks.size() - 1) * chunk_rows + chunks.back().rows();
  }
  /// Blocks that are stored.
  std::int64_t num_entries() const;
  Row row(Index i) const {
    const Chunk& chunk = chunks[i / chunk_rows];
    const Index r = i % chunk_rows, first = chunk.offsets[r];
    const auto count = static_cast<std::size_t>(chunk.offsets[r + 1] - first);
    return {{chunk.columns.data() + first, count}, {chunk.blocks.data() + first, count}, chunk.diagonal[r] - first};
  }
  const Mat<Dim>& diagonal(Index i) const {
    const Chunk& chunk = chunks[i / chunk_rows];
    return chunk.blocks[chunk.diagonal[i % chunk_rows]];
  }
  /// Block (i, j). Throws std::out_of_range if there is none.
  Mat<Dim>& block(Index i, Index j);
  /// y = A x; both Dim x size().
  void multiply(const Points<Dim>& x, Points<Dim>& y) const;
};

}  // namespace efree
