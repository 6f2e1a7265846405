// SPDX-License-Identifier: GPL-3.0-or-later
/// Smoother for block matrices: what is rough in an error goes.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"

#include <functional>
#include <span>
#include <vector>

namespace efree {

/// Polynomial in B K, B symmetric Gauss-Seidel sweeps within chunks of nodes (block Jacobi between them, so that
/// threads change nothing), chosen by Chebyshev to be small on the upper part of the spectrum (Adams, Brezina, Hu &
/// Tuminaro 2003). Symmetric and positive definite on what is free. In single precision, of K with unit diagonal, which
/// is half of what has to be read: rounding makes it another smoother, and no other answer.
template <int Dim> class Smoother {
 public:
  /// free(node): projector onto the directions that are not held. Estimates the largest eigenvalue of B K, unless the
  /// highest degree that is to be applied is 1, which needs none.
  Smoother(const BlockMatrix<Dim>& K, const std::function<Mat<Dim>(Index)>& free, int highest);
  /// z = M r, each Dim x K.size(), by a polynomial of this degree; several as one by one but for rounding.
  void apply(const BlockMatrix<Dim>& K, int degree, const std::vector<const Points<Dim>*>& r,
             const std::vector<Points<Dim>*>& z) const;

 private:
  void apply_at_once(const BlockMatrix<Dim>& K, int degree, std::span<const Points<Dim>* const> r,
                     std::span<Points<Dim>* const> z) const;

  /// By node: B of the diagonal block, on what is free, and the root of that block's mean stiffness, which K is
  /// divided by.
  std::vector<Eigen::Matrix<float, Dim, Dim>> inverse_diagonal_;
  Vector scale_;
  std::vector<std::vector<Eigen::Matrix<float, Dim, Dim>>> blocks_;  ///< of K, by chunk and entry
  double largest_ = 1.0;                                             ///< eigenvalue of B K, at least
};

constexpr int highest_degree = 32;

/// Degree, at most `highest_degree`, of a smoother's polynomial for a coarse space that takes over at this distance, in
/// nodes of the matrix.
int smoothing_degree(double reach);

}  // namespace efree
