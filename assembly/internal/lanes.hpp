// SPDX-License-Identifier: GPL-3.0-or-later
/// Vectors of several right-hand sides side by side: node by node, the numbers of all lanes for each component next to
/// each other. For functions that are EFREE_FOR_EACH_MACHINE.
#pragma once

#include "efree/core/internal/vectors.hpp"
#include "efree/core/types.hpp"

#include <cstddef>
#include <cstring>

namespace efree {

template <class Number, int lanes> struct LanesOf {
  typedef Number type __attribute__((vector_size(sizeof(Number) * lanes)));  // NOLINT: GCC drops it from an alias
};
template <class Number> struct LanesOf<Number, 1> { using type = Number; };

/// The components at one node, in all lanes.
template <class Number, int Dim, int lanes> struct NodeLanes {
  typename LanesOf<Number, lanes>::type of[Dim];

  static constexpr std::ptrdiff_t size = Dim * lanes;  ///< numbers
  // Component by component, or they stay in memory.
  EFREE_INLINE void load(const Number* vector, Index node) {
    for (int p = 0; p < Dim; ++p) std::memcpy(&of[p], vector + size * node + lanes * p, sizeof of[p]);
  }
  EFREE_INLINE void store(Number* vector, Index node) const {
    for (int p = 0; p < Dim; ++p) std::memcpy(vector + size * node + lanes * p, &of[p], sizeof of[p]);
  }
  EFREE_INLINE void clear() {
    for (int p = 0; p < Dim; ++p) of[p] = typename LanesOf<Number, lanes>::type{};
  }
  EFREE_INLINE void add(const NodeLanes& other) {
    for (int p = 0; p < Dim; ++p) of[p] += other.of[p];
  }
  EFREE_INLINE void add(Number factor, const NodeLanes& other) {
    for (int p = 0; p < Dim; ++p) of[p] += factor * other.of[p];
  }
  /// Adds block . v, the block column after column.
  EFREE_INLINE void add(const Number* block, const NodeLanes& v) {
    for (int p = 0; p < Dim; ++p) {
      auto sum = block[p] * v.of[0];
      for (int q = 1; q < Dim; ++q) sum += block[p + Dim * q] * v.of[q];
      of[p] += sum;
    }
  }
  EFREE_INLINE void subtract(const Number* block, const NodeLanes& v) {
    for (int p = 0; p < Dim; ++p) {
      auto sum = block[p] * v.of[0];
      for (int q = 1; q < Dim; ++q) sum += block[p + Dim * q] * v.of[q];
      of[p] -= sum;
    }
  }
  /// Adds block^T . v.
  EFREE_INLINE void add_mirrored(const Number* block, const NodeLanes& v) {
    for (int p = 0; p < Dim; ++p) {
      auto sum = block[Dim * p] * v.of[0];
      for (int q = 1; q < Dim; ++q) sum += block[q + Dim * p] * v.of[q];
      of[p] += sum;
    }
  }
};

/// Rows of a chunk of a BlockMatrix as kernels see them.
template <class Number> struct BlockRows {
  Index first, count;                               ///< rows
  const Index *offsets, *own, *diagonal, *columns;  ///< as BlockMatrix::Chunk has them
  const Number* blocks;                             ///< by entry

  template <int Dim> EFREE_INLINE const Number* block(Index k) const {
    return blocks + Dim * Dim * static_cast<std::ptrdiff_t>(k);
  }
};

/// y += A x in these rows; x: of node 0, y: of the first row.
template <int Dim, int lanes, class Number>
EFREE_INLINE void add_product(const BlockRows<Number>& rows, const Number* x, Number* y) {
  NodeLanes<Number, Dim, lanes> own, sum, other;
  for (Index row = 0; row < rows.count; ++row) {
    own.load(x, rows.first + row);
    sum.clear();
    for (Index k = rows.offsets[row]; k < rows.own[row]; ++k) {
      other.load(x, rows.columns[k]);
      sum.add(rows.template block<Dim>(k), other);
    }
    for (Index k = rows.own[row]; k < rows.diagonal[row]; ++k) {
      other.load(x, rows.columns[k]);
      sum.add(rows.template block<Dim>(k), other);
      other.load(y, rows.columns[k] - rows.first);
      other.add_mirrored(rows.template block<Dim>(k), own);
      other.store(y, rows.columns[k] - rows.first);
    }
    for (Index k = rows.diagonal[row]; k < rows.offsets[row + 1]; ++k) {
      other.load(x, rows.columns[k]);
      sum.add(rows.template block<Dim>(k), other);
    }
    other.load(y, row);
    other.add(sum);
    other.store(y, row);
  }
}

}  // namespace efree
