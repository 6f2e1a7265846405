// SPDX-License-Identifier: GPL-3.0-or-later
/// Smoother for block matrices: what is rough in an error goes.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"

#include <functional>

namespace efree {

/// Polynomial in B K, B symmetric Gauss-Seidel sweeps within chunks of nodes (block Jacobi between them, so that
/// threads change nothing), chosen by Chebyshev to be small on the upper part of the spectrum (Adams, Brezina, Hu &
/// Tuminaro 2003). Symmetric and positive definite on what is free.
template <int Dim> class Smoother {
 public:
  /// free(node): projector onto the directions that are not held. Estimates the largest eigenvalue of B K, unless the
  /// highest degree that is to be applied is 1, which needs none.
  Smoother(const BlockMatrix<Dim>& K, const std::function<Mat<Dim>(Index)>& free, int highest);
  /// z = M r, both Dim x K.size(), by a polynomial of this degree.
  void apply(const BlockMatrix<Dim>& K, int degree, const Points<Dim>& r, Points<Dim>& z) const {
    apply(K, degree, std::vector<const Points<Dim>*>{&r}, std::vector<Points<Dim>*>{&z});
  }
  /// The same for several; as one by one but for rounding.
  void apply(const BlockMatrix<Dim>& K, int degree, const std::vector<const Points<Dim>*>& r,
             const std::vector<Points<Dim>*>& z) const;

 private:
  void apply(const BlockMatrix<Dim>& K, int degree, const Eightfold<Dim>& r, Eightfold<Dim>& z) const;
  void apply_to_few(const BlockMatrix<Dim>& K, int degree, const std::vector<const Points<Dim>*>& r,
                    const std::vector<Points<Dim>*>& z) const;
  void sweep(const BlockMatrix<Dim>& K, const Eightfold<Dim>& r, Eightfold<Dim>& z) const;
  void sweep(const BlockMatrix<Dim>& K, const std::vector<const Points<Dim>*>& r,
             const std::vector<Points<Dim>*>& z) const;

  std::vector<Mat<Dim>> inverse_diagonal_;  ///< on what is free
  double largest_ = 1.0;                    ///< eigenvalue of B K, at least
};

constexpr int highest_degree = 32;

/// Degree, at most `highest_degree`, of a smoother's polynomial for a coarse space that takes over at this distance, in
/// nodes of the matrix.
int smoothing_degree(double reach);

}  // namespace efree
