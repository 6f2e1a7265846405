// SPDX-License-Identifier: GPL-3.0-or-later
/// Conjugate gradients where factors are dear, factors elsewhere.
#pragma once

#include "efree/solvers/linear/linear_solver.hpp"

#include <memory>

namespace efree {

/// Cholesky; where the factor is nearly full, as those of large clouds in space are, conjugate gradients, which take a
/// fraction of the time and memory, and the factor only where they do not come to their end: of indefinite matrices and
/// of ill-conditioned ones. Which it is depends on nothing but the matrix and what has been asked of it since it was
/// given, so that paths that are resumed are the same bit for bit.
class HybridSolver final : public LinearSolver {
 public:
  /// What conjugate gradients leave of a right-hand side. Newton's method squares errors down to there, and takes what
  /// is left away with the next change (inexact Newton methods: Dembo, Eisenstat & Steihaug 1982).
  static constexpr double tolerance = 1e-7;

  HybridSolver();
  ~HybridSolver() override;
  HybridSolver(HybridSolver&&) noexcept;
  HybridSolver& operator=(HybridSolver&&) noexcept;

  void analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of = {}) override;
  /// Takes the matrix; singular ones may be found out by what is asked of it later.
  void factorize(const SymmetricMatrix& lower) override;
  /// Without a factor: conjugate gradients that come to an end from a random vector have met all eigenvectors, so there
  /// is none with a negative eigenvalue; else the factor counts.
  Index negative_pivots() const override;
  /// To rounding with a factor, without to the tolerance.
  Matrix solve(const Eigen::Ref<const Matrix>& B) const override;
  /// Whether the last matrix has been factored.
  bool has_factor() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace efree
