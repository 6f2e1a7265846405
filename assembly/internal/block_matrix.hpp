// SPDX-License-Identifier: GPL-3.0-or-later
/// Symmetric sparse matrices of small dense blocks, stored for fast products.
#pragma once

#include "efree/assembly/internal/lanes.hpp"
#include "efree/core/types.hpp"

#include <cstdint>
#include <vector>

namespace efree {

/// Symmetric matrix of Dim x Dim blocks, one row and column for each node. Rows lie in chunks. Of two blocks that
/// mirror each other within a chunk the lower one is stored, across chunks both are: a chunk's part of a product needs
/// nothing but its own rows, so that products run in parallel and are bitwise the same on any number of threads, and a
/// matrix can be made, and remade, chunk by chunk.
template <int Dim> struct BlockMatrix {
  static constexpr Index chunk_rows = 8192;
  /// Consecutive rows: all have `chunk_rows` but the last. Columns ascend: those before the chunk, those of the chunk
  /// up to the diagonal, which is always there, and those after the chunk.
  struct Chunk {
    struct Mirror {
      Index row, entry;
    };
    std::vector<Index> offsets{0};  ///< row r of the chunk has the entries offsets[r] .. offsets[r+1]
    std::vector<Index> own;         ///< by row: its first entry in the chunk,
    std::vector<Index> diagonal;    ///< its last one
    std::vector<Index> columns;     ///< by entry
    std::vector<Mat<Dim>> blocks;   ///< by entry
    Ragged<Mirror> mirrors;         ///< by row: the entries below the diagonal in its column, and their rows

    Index rows() const { return static_cast<Index>(diagonal.size()); }
    /// As kernels see it, the first row being number `first` of the matrix, with these blocks or others.
    template <class Number> BlockRows<Number> with(Index first, const Number* of_entries) const {
      return {first, rows(), offsets.data(), own.data(), diagonal.data(), columns.data(), of_entries};
    }
    /// Ends the row of this number in the matrix: its columns are those beyond the row before.
    void close_row(Index number);
    /// Ends the chunk.
    void close();
  };
  std::vector<Chunk> chunks;

  Index size() const {
    return chunks.empty() ? 0 : static_cast<Index>(chunks.size() - 1) * chunk_rows + chunks.back().rows();
  }
  /// Whether block (i, j), if it is not zero, is stored: it or its mirror image is.
  static bool stores(Index i, Index j) { return j <= i || j / chunk_rows != i / chunk_rows; }
  /// Blocks that are stored.
  std::int64_t num_entries() const;
  /// Calls visit(j, block (i, j)) for all blocks in row i.
  template <class Visit> void for_row(Index i, const Visit& visit) const {
    const Chunk& chunk = chunks[i / chunk_rows];
    const Index r = i % chunk_rows;
    for (Index e = chunk.offsets[r]; e < chunk.offsets[r + 1]; ++e) visit(chunk.columns[e], chunk.blocks[e]);
    for (const auto& [row, entry] : chunk.mirrors[r]) visit(i - r + row, Mat<Dim>(chunk.blocks[entry].transpose()));
  }
  const Mat<Dim>& diagonal(Index i) const {
    const Chunk& chunk = chunks[i / chunk_rows];
    return chunk.blocks[chunk.diagonal[i % chunk_rows]];
  }
  /// Block (i, j), one that is stored. Throws std::out_of_range if it is not.
  Mat<Dim>& block(Index i, Index j);
  /// y = A x; both Dim x size().
  void multiply(const Points<Dim>& x, Points<Dim>& y) const;
  /// The same for several, none of which is another one's product; as one by one but for rounding.
  void multiply(const std::vector<const Points<Dim>*>& x, const std::vector<Points<Dim>*>& y) const;
};

}  // namespace efree
