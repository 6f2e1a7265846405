// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/block_matrix.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <stdexcept>

namespace efree {

template <int Dim> void BlockMatrix<Dim>::Chunk::close_row(Index number) {
  const auto at = std::lower_bound(columns.begin() + offsets.back(), columns.end(), number);
  diagonal.push_back(static_cast<Index>(at - columns.begin()));
  offsets.push_back(static_cast<Index>(columns.size()));
}

template <int Dim> std::int64_t BlockMatrix<Dim>::num_entries() const {
  std::int64_t count = 0;
  for (const Chunk& chunk : chunks) count += static_cast<std::int64_t>(chunk.columns.size());
  return count;
}

template <int Dim> Mat<Dim>& BlockMatrix<Dim>::block(Index i, Index j) {
  Chunk& chunk = chunks[i / chunk_rows];
  const Index r = i % chunk_rows;
  const auto begin = chunk.columns.begin() + chunk.offsets[r], end = chunk.columns.begin() + chunk.offsets[r + 1];
  const auto found = std::lower_bound(begin, end, j);
  if (found == end || *found != j) throw std::out_of_range("no such block");
  return chunk.blocks[found - chunk.columns.begin()];
}

template <int Dim> void BlockMatrix<Dim>::multiply(const Points<Dim>& x, Points<Dim>& y) const {
  y.resize(Dim, size());
  parallel_chunks(size(), chunk_rows, [&](Index begin, Index end) {
    const Chunk& chunk = chunks[begin / chunk_rows];
    for (Index i = begin; i < end; ++i) {
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (Index k = chunk.offsets[i - begin]; k < chunk.offsets[i - begin + 1]; ++k)
        sum.noalias() += chunk.blocks[k] * x.col(chunk.columns[k]);
      y.col(i) = sum;
    }
  });
}

template struct BlockMatrix<2>;
template struct BlockMatrix<3>;

}  // namespace efree
