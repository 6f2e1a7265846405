// SPDX-License-Identifier: GPL-3.0-or-later
/// Decompositions of dense, mostly small matrices. Compiled once, since Eigen's take a compiler seconds wherever they
/// stand. Of symmetric ones only the lower triangles are read; N = 2, 3, 4, 6, 10 or Eigen::Dynamic (eigenvalues alone:
/// 2, 3, 6 or that).
#pragma once

#include "efree/core/types.hpp"

namespace efree::internal {

template <int N> struct Spectrum {
  Vec<N> values;   ///< ascending
  Mat<N> vectors;  ///< by column
};
template <int N> Spectrum<N> spectrum(const Mat<N>& symmetric);
template <int N> Vec<N> eigenvalues(const Mat<N>& symmetric);  ///< ascending

/// Moore-Penrose inverse; eigenvalues up to 1e-12 times the largest in absolute value count as zero. N = 2, 3 or
/// Eigen::Dynamic.
template <int N> Mat<N> pseudo_inverse(const Mat<N>& symmetric);

/// The smallest of all x that bring matrix x closest to the right-hand sides, by column.
Eigen::Matrix<double, 3, 9> least_squares_solution(const Mat<3>& matrix, const Eigen::Matrix<double, 3, 9>& right);

/// R of the QR decomposition of a matrix with at least as many rows as columns: upper triangular, R^T R = tall^T tall.
/// Entries of its diagonal may be negative.
Matrix triangular_factor(const Matrix& tall);
/// Orthonormal basis of what the columns of a matrix span, which are independent.
Matrix orthonormal_columns(const Matrix& tall);

}  // namespace efree::internal
