// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/block_matrix.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <numeric>
#include <stdexcept>

namespace efree {

template <int Dim> void BlockMatrix<Dim>::Chunk::close_row(Index number) {
  const auto begin = columns.begin() + offsets.back();
  const auto first = std::lower_bound(begin, columns.end(), number - number % chunk_rows);
  own.push_back(static_cast<Index>(first - columns.begin()));
  diagonal.push_back(static_cast<Index>(std::lower_bound(first, columns.end(), number) - columns.begin()));
  offsets.push_back(static_cast<Index>(columns.size()));
}

template <int Dim> void BlockMatrix<Dim>::Chunk::close() {
  if (rows() == 0) return;
  columns.shrink_to_fit();
  blocks.shrink_to_fit();
  const Index first = columns[diagonal[0]];
  mirrors.offsets.assign(rows() + 1, 0);
  for (Index r = 0; r < rows(); ++r)
    for (Index e = own[r]; e < diagonal[r]; ++e) ++mirrors.offsets[columns[e] - first + 1];
  std::partial_sum(mirrors.offsets.begin(), mirrors.offsets.end(), mirrors.offsets.begin());
  mirrors.items.resize(mirrors.offsets.back());
  std::vector<Index> cursor(mirrors.offsets.begin(), mirrors.offsets.end() - 1);
  for (Index r = 0; r < rows(); ++r)
    for (Index e = own[r]; e < diagonal[r]; ++e) mirrors.items[cursor[columns[e] - first]++] = {r, e};
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
    y.middleCols(begin, end - begin).setZero();
    for (Index i = begin; i < end; ++i) {
      const Index r = i - begin;
      const Vec<Dim> moved = x.col(i);
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (Index k = chunk.offsets[r]; k < chunk.own[r]; ++k)
        sum.noalias() += chunk.blocks[k] * x.col(chunk.columns[k]);
      for (Index k = chunk.own[r]; k < chunk.diagonal[r]; ++k) {
        sum.noalias() += chunk.blocks[k] * x.col(chunk.columns[k]);
        y.col(chunk.columns[k]).noalias() += chunk.blocks[k].transpose() * moved;
      }
      for (Index k = chunk.diagonal[r]; k < chunk.offsets[r + 1]; ++k)
        sum.noalias() += chunk.blocks[k] * x.col(chunk.columns[k]);
      y.col(i) += sum;
    }
  });
}

template struct BlockMatrix<2>;
template struct BlockMatrix<3>;

}  // namespace efree
