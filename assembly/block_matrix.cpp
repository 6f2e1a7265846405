// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/block_matrix.hpp"

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <stdexcept>

namespace efree {

template <int Dim> Index BlockMatrix<Dim>::entry(Index i, Index j) const {
  const auto begin = columns.begin() + offsets[i], end = columns.begin() + offsets[i + 1];
  const auto found = std::lower_bound(begin, end, j);
  if (found == end || *found != j) throw std::out_of_range("no such block");
  return static_cast<Index>(found - columns.begin());
}

template <int Dim> void BlockMatrix<Dim>::multiply(const Points<Dim>& x, Points<Dim>& y) const {
  y.resize(Dim, size());
  parallel_chunks(size(), 8192, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) {
      Vec<Dim> sum = Vec<Dim>::Zero();
      for (Index k = offsets[i]; k < offsets[i + 1]; ++k) sum.noalias() += blocks[k] * x.col(columns[k]);
      y.col(i) = sum;
    }
  });
}

template struct BlockMatrix<2>;
template struct BlockMatrix<3>;

}  // namespace efree
