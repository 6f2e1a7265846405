// SPDX-License-Identifier: GPL-3.0-or-later
/// Up to eight vectors side by side, so that what is read of a matrix serves all of them.
#pragma once

#include "efree/core/types.hpp"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

namespace efree {

/// Vectors from which on products take less time side by side, packing included.
constexpr std::size_t worth_packing = 3;

/// Eight vectors, Dim x nodes each: the numbers of all eight at a place are next to each other.
template <int Dim> class Eightfold {
 public:
  /// Values are not set.
  explicit Eightfold(Index nodes)
      : nodes_(nodes), values_(std::make_unique_for_overwrite<double[]>(8 * Dim * static_cast<std::size_t>(nodes))) {}
  /// Holds these (no more than eight, Dim x nodes), and zeros.
  explicit Eightfold(std::span<const Points<Dim>* const> vectors);

  /// The vectors again.
  void unpack(std::span<Points<Dim>* const> vectors) const;

  Index nodes() const { return nodes_; }
  /// Of a node: eight numbers for each component.
  double* at(Index node) { return values_.get() + 8 * Dim * static_cast<std::size_t>(node); }
  const double* at(Index node) const { return values_.get() + 8 * Dim * static_cast<std::size_t>(node); }

 private:
  Index nodes_;
  std::unique_ptr<double[]> values_;
};

/// Makes y of x: side by side, by packed(from, to), as long as there are enough of them, and the rest by few(x, y).
template <int Dim, class Packed, class Few> void in_eights(const std::vector<const Points<Dim>*>& x,
                                                           const std::vector<Points<Dim>*>& y, const Packed& packed,
                                                           const Few& few) {
  std::size_t done = 0;
  while (x.size() - done >= worth_packing) {
    const std::size_t count = std::min<std::size_t>(x.size() - done, 8);
    const auto given = std::span(x).subspan(done, count);
    const Eightfold<Dim> from(given);
    Eightfold<Dim> to(from.nodes());
    packed(from, to);
    to.unpack(std::span(y).subspan(done, count));
    done += count;
  }
  const auto rest = static_cast<std::ptrdiff_t>(done);
  if (done < x.size()) few(std::vector(x.begin() + rest, x.end()), std::vector(y.begin() + rest, y.end()));
}

/// Rows of a chunk of a BlockMatrix as the kernels see them.
struct BlockRows {
  Index first, count;  ///< rows
  const Index *offsets, *own, *diagonal, *columns;
  const double* blocks;
};
/// y = A x in these rows, for blocks of 2 x 2 and 3 x 3. x, y: of node 0.
void multiply_eightfold_2(const BlockRows& rows, const double* x, double* y);
void multiply_eightfold_3(const BlockRows& rows, const double* x, double* y);
/// z = B r, B a symmetric Gauss-Seidel sweep within these rows; `inverse`: of the diagonal blocks, by row of the
/// matrix; `ahead`: room for the rows.
void sweep_eightfold_2(const BlockRows& rows, const double* inverse, const double* r, double* z, double* ahead);
void sweep_eightfold_3(const BlockRows& rows, const double* inverse, const double* r, double* z, double* ahead);

}  // namespace efree
