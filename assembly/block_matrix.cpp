// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/block_matrix.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <memory>
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

namespace {

constexpr int together = 8;
/// Vectors from which on products take less time side by side, packing included.
constexpr std::size_t worth_packing = 3;

template <int Dim>
EFREE_INLINE void multiply_lanes(int lanes, const BlockRows<double>& rows, const double* x, double* y) {
  if (lanes == 1)
    add_product<Dim, 1>(rows, x, y);
  else
    add_product<Dim, together>(rows, x, y);
}

}  // namespace

EFREE_FOR_EACH_MACHINE void multiply_rows(int dim, int lanes, const BlockRows<double>& rows, const double* x,
                                          double* y) {
  if (dim == 2)
    multiply_lanes<2>(lanes, rows, x, y);
  else
    multiply_lanes<3>(lanes, rows, x, y);
}

template <int Dim> void BlockMatrix<Dim>::multiply(const Points<Dim>& x, Points<Dim>& y) const {
  y.resize(Dim, size());
  parallel_chunks(size(), chunk_rows, [&](Index begin, Index end) {
    y.middleCols(begin, end - begin).setZero();
    const Chunk& chunk = chunks[begin / chunk_rows];
    multiply_rows(Dim, 1, chunk.with(begin, chunk.blocks.front().data()), x.data(), y.col(begin).data());
  });
}

template <int Dim>
void BlockMatrix<Dim>::multiply(const std::vector<const Points<Dim>*>& x, const std::vector<Points<Dim>*>& y) const {
  std::size_t done = 0;
  for (std::size_t count; (count = std::min<std::size_t>(x.size() - done, together)) >= worth_packing; done += count) {
    const auto packed = std::make_unique_for_overwrite<double[]>(std::size_t{Dim} * together * size());
    const auto at = [](Index node) { return std::ptrdiff_t{Dim} * together * node; };
    parallel_chunks(size(), chunk_rows, [&](Index begin, Index end) {
      double* to = packed.get() + at(begin);
      for (std::ptrdiff_t i = std::ptrdiff_t{Dim} * begin; i < std::ptrdiff_t{Dim} * end; ++i, to += together)
        for (std::size_t lane = 0; lane < together; ++lane) to[lane] = lane < count ? x[done + lane]->data()[i] : 0.0;
    });
    for (std::size_t lane = 0; lane < count; ++lane) y[done + lane]->resize(Dim, size());
    parallel_chunks(size(), chunk_rows, [&](Index begin, Index end) {
      std::vector<double> products(at(end - begin), 0.0);
      const Chunk& chunk = chunks[begin / chunk_rows];
      multiply_rows(Dim, together, chunk.with(begin, chunk.blocks.front().data()), packed.get(), products.data());
      const double* from = products.data();
      for (std::ptrdiff_t i = std::ptrdiff_t{Dim} * begin; i < std::ptrdiff_t{Dim} * end; ++i, from += together)
        for (std::size_t lane = 0; lane < count; ++lane) y[done + lane]->data()[i] = from[lane];
    });
  }
  for (; done < x.size(); ++done) multiply(*x[done], *y[done]);
}

template struct BlockMatrix<2>;
template struct BlockMatrix<3>;

}  // namespace efree
