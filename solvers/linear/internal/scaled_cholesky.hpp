// SPDX-License-Identifier: GPL-3.0-or-later
/// Cholesky factors of matrices that are nearly singular.
#pragma once

#include "efree/core/error.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <optional>
#include <vector>

namespace efree {

/// A matrix scaled to a unit diagonal and factored: bodies of a few cells next to stiff ones are no reason to fail.
/// Where unknowns depend on each other a little on the diagonal decides between them, and the iterations see to the
/// rest.
class ScaledCholesky {
 public:
  /// Lower triangle, diagonal positive; each node has `unknowns`, one after the other. Throws like Cholesky.
  ScaledCholesky(SymmetricMatrix matrix, int unknowns) : scale_(matrix.diagonal().cwiseSqrt().cwiseInverse()) {
    for (Index column = 0; column < matrix.cols(); ++column)
      for (SymmetricMatrix::InnerIterator entry(matrix, column); entry; ++entry)
        entry.valueRef() *= scale_[entry.row()] * scale_[column];
    std::vector<Index> node_of(matrix.rows());
    for (Index i = 0; i < matrix.rows(); ++i) node_of[i] = i / unknowns;
    try {
      factor_.emplace(matrix, node_of);
    } catch (const NumericalError&) {
      for (Index i = 0; i < matrix.cols(); ++i) matrix.coeffRef(i, i) += 1e-10;
      factor_.emplace(matrix, node_of);
    }
  }
  /// For each column.
  Matrix solve_all(const Matrix& B) const { return scale_.asDiagonal() * factor_->solve(scale_.asDiagonal() * B); }
  Vector solve(const Vector& b) const { return scale_.cwiseProduct(factor_->solve(scale_.cwiseProduct(b)).col(0)); }

 private:
  Vector scale_;
  std::optional<Cholesky> factor_;
};

}  // namespace efree
