// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/block_matrix.hpp"

#include "efree/assembly/internal/few.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <array>
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

template <int Dim> void BlockMatrix<Dim>::multiply(const Eightfold<Dim>& x, Eightfold<Dim>& y) const {
  parallel_chunks(size(), chunk_rows, [&](Index begin, Index) {
    const BlockRows rows = rows_of(begin / chunk_rows);
    if constexpr (Dim == 2)
      multiply_eightfold_2(rows, x.at(0), y.at(0));
    else
      multiply_eightfold_3(rows, x.at(0), y.at(0));
  });
}

template <int Dim>
void BlockMatrix<Dim>::multiply(const std::vector<const Points<Dim>*>& x, const std::vector<Points<Dim>*>& y) const {
  in_eights<Dim>(
      x, y, [&](const Eightfold<Dim>& from, Eightfold<Dim>& to) { multiply(from, to); },
      [&](const auto& from, const auto& to) { multiply_few(from, to); });
}

template <int Dim> void BlockMatrix<Dim>::multiply_few(const std::vector<const Points<Dim>*>& x,
                                                       const std::vector<Points<Dim>*>& y) const {
  for (Points<Dim>* one : y) one->resize(Dim, size());
  for_few(x.size(), [&]<int n>(std::size_t first, std::integral_constant<int, n>) {
    using Column = Eigen::Map<Vec<Dim>>;
    using Given = Eigen::Map<const Vec<Dim>>;
    std::array<const double*, n> from;
    std::array<double*, n> to;
    for (int c = 0; c < n; ++c) from[c] = x[first + c]->data(), to[c] = y[first + c]->data();
    parallel_chunks(size(), chunk_rows, [&, from, to](Index begin, Index end) {
      const auto at = [](auto* data, Index i) { return data + static_cast<std::ptrdiff_t>(Dim) * i; };
      const Chunk& chunk = chunks[begin / chunk_rows];
      for (int c = 0; c < n; ++c) std::fill(at(to[c], begin), at(to[c], end), 0.0);
      for (Index i = begin; i < end; ++i) {
        const Index r = i - begin;
        std::array<Vec<Dim>, n> moved, sum;
        for (int c = 0; c < n; ++c) moved[c] = Given(at(from[c], i)), sum[c].setZero();
        for (Index k = chunk.offsets[r]; k < chunk.own[r]; ++k)
          for (int c = 0; c < n; ++c) sum[c].noalias() += chunk.blocks[k] * Given(at(from[c], chunk.columns[k]));
        for (Index k = chunk.own[r]; k < chunk.diagonal[r]; ++k) {
          const Mat<Dim> block = chunk.blocks[k];
          const Index j = chunk.columns[k];
          for (int c = 0; c < n; ++c) {
            sum[c].noalias() += block * Given(at(from[c], j));
            Column(at(to[c], j)).noalias() += block.transpose() * moved[c];
          }
        }
        for (Index k = chunk.diagonal[r]; k < chunk.offsets[r + 1]; ++k)
          for (int c = 0; c < n; ++c) sum[c].noalias() += chunk.blocks[k] * Given(at(from[c], chunk.columns[k]));
        for (int c = 0; c < n; ++c) Column(at(to[c], i)) += sum[c];
      }
    });
  });
}

template struct BlockMatrix<2>;
template struct BlockMatrix<3>;

}  // namespace efree
