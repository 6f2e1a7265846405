// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/smoothing_pass.hpp"

#include <algorithm>

namespace efree {
namespace {

/// swept = B swept.
template <int Dim, int lanes> EFREE_INLINE void sweep(const SmoothingPass& at) {
  NodeLanes<float, Dim, lanes> left, there, other;
  const BlockRows<float>& rows = at.rows;
  for (Index row = 0; row < rows.count; ++row) {
    left.load(at.swept, row);
    for (Index k = rows.own[row]; k < rows.diagonal[row]; ++k) {
      other.load(at.swept, rows.columns[k] - rows.first);
      left.subtract(rows.block<Dim>(k), other);
    }
    there.clear();
    there.add(at.inverse + Dim * Dim * static_cast<std::ptrdiff_t>(rows.first + row), left);
    there.store(at.swept, row);
  }
  std::fill_n(at.ahead, there.size * rows.count, 0.0f);  // forces by the rows that are done
  for (Index row = rows.count - 1; row >= 0; --row) {
    there.load(at.swept, row);
    left.load(at.ahead, row);
    there.subtract(at.inverse + Dim * Dim * static_cast<std::ptrdiff_t>(rows.first + row), left);
    there.store(at.swept, row);
    for (Index k = rows.own[row]; k < rows.diagonal[row]; ++k) {
      other.load(at.ahead, rows.columns[k] - rows.first);
      other.add_mirrored(rows.block<Dim>(k), there);
      other.store(at.ahead, rows.columns[k] - rows.first);
    }
  }
}

template <int Dim, int lanes> EFREE_INLINE void smooth(const SmoothingPass& at) {
  constexpr std::ptrdiff_t size = NodeLanes<float, Dim, lanes>::size;
  const std::ptrdiff_t from = size * at.rows.first, count = size * at.rows.count;
  if (at.z) {
    std::fill_n(at.swept, count, 0.0f);
    add_product<Dim, lanes>(at.rows, at.z, at.swept);
    for (std::ptrdiff_t i = 0; i < count; ++i) at.swept[i] = at.r[from + i] - at.swept[i];
  } else {
    std::copy_n(at.r + from, count, at.swept);
  }
  sweep<Dim, lanes>(at);
  float* const next = at.next + from;
  if (at.z) {
    const float* const z = at.z + from;
    for (std::ptrdiff_t i = 0; i < count; ++i) next[i] = z[i] + (at.keep * (z[i] - next[i]) + at.take * at.swept[i]);
  } else {
    for (std::ptrdiff_t i = 0; i < count; ++i) next[i] = at.take * at.swept[i];
  }
}

template <int Dim> EFREE_INLINE void smooth_lanes(int lanes, const SmoothingPass& pass) {
  switch (lanes) {
    case 1:
      return smooth<Dim, 1>(pass);
    case 4:
      return smooth<Dim, 4>(pass);
    case 8:
      return smooth<Dim, 8>(pass);
    default:
      return smooth<Dim, most_lanes>(pass);
  }
}

}  // namespace

EFREE_FOR_EACH_MACHINE void smooth_rows(int dim, int lanes, const SmoothingPass& pass) {
  if (dim == 2)
    smooth_lanes<2>(lanes, pass);
  else
    smooth_lanes<3>(lanes, pass);
}

}  // namespace efree
