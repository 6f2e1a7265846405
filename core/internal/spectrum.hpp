// SPDX-License-Identifier: GPL-3.0-or-later
/// Decompositions of small symmetric matrices (only their lower triangles are read). Compiled once, since Eigen's take
/// a compiler seconds wherever they stand; N = 2, 3, 4, 6, 10 or Eigen::Dynamic (eigenvalues alone: 2, 3, 6 or that).
#pragma once

#include "efree/core/types.hpp"

namespace efree::internal {

template <int N> struct Spectrum {
  Vec<N> values;   ///< ascending
  Mat<N> vectors;  ///< by column
};
template <int N> Spectrum<N> spectrum(const Mat<N>& symmetric);
template <int N> Vec<N> eigenvalues(const Mat<N>& symmetric);  ///< ascending

/// Of Moore and Penrose, of any square matrix; N = 2 or 3.
template <int N> Mat<N> pseudo_inverse(const Mat<N>& matrix);

/// The smallest of all x that bring matrix x closest to the right-hand sides, by column; Columns = 1 or 9.
template <int Columns>
Eigen::Matrix<double, 3, Columns> least_squares_solution(const Mat<3>& matrix,
                                                         const Eigen::Matrix<double, 3, Columns>& right);

}  // namespace efree::internal
