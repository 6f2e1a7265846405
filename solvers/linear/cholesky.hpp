// SPDX-License-Identifier: GPL-3.0-or-later
/// Sparse Cholesky factorisation: ordering, supernodes and solves by CHOLMOD (Chen, Davis, Hager, Rajamanickam 2008),
/// numbers on several threads, BLAS on one.
#pragma once

#include "efree/solvers/linear/linear_solver.hpp"

#include <memory>
#include <vector>

namespace efree {

/// Supernodal L L^T; L S L^T, S the signs of the pivots, where that ends at one that is not positive. Bitwise
/// reproducible for any number of threads.
class Cholesky final : public LinearSolver {
 public:
  Cholesky();
  /// Analyses and factors. Throws as these do, and NumericalError naming the first unknown at which the matrix is not
  /// positive definite.
  explicit Cholesky(const SymmetricMatrix& lower, const std::vector<Index>& node_of = {});
  ~Cholesky() override;
  Cholesky(Cholesky&&) noexcept;
  Cholesky& operator=(Cholesky&&) noexcept;

  /// Throws InputError for nodes that are not as many or not ascending, more unknowns than CHOLMOD can number, or too
  /// little memory for the factor.
  void analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of = {}) override;
  /// Throws InputError for a matrix of another size or pattern than was analysed.
  void factorize(const SymmetricMatrix& lower) override;
  /// Factors a matrix that is positive definite. Throws NumericalError naming the first unknown at which it is not.
  void factorize_definite(const SymmetricMatrix& lower);
  /// Factors a matrix that is positive definite. Whether it is: there is no factor else, and none with signs.
  bool factorize_if_definite(const SymmetricMatrix& lower);
  Index negative_pivots() const override;
  Matrix solve(const Eigen::Ref<const Matrix>& B) const override;
  /// Entries of the factor.
  double factor_entries() const;
  /// Multiplications and additions that a supernodal factor of what was analysed takes.
  double operations() const;

 private:
  void begin(const SymmetricMatrix& lower);

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace efree
