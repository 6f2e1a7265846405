// SPDX-License-Identifier: GPL-3.0-or-later
/// Sparse Cholesky factorisation by CHOLMOD (Chen, Davis, Hager, Rajamanickam 2008), supernodal, BLAS on one thread.
#pragma once

#include "efree/assembly/operators.hpp"

#include <memory>
#include <vector>

namespace efree {

/// Analyses and factors once; solves any number of right-hand sides. Bitwise reproducible for any number of threads.
class Cholesky {
 public:
  /// `node_of` numbers the node of each unknown, ascending: then nodes are ordered, not unknowns, which is several
  /// times faster and gives factors as sparse. Without it every unknown is a node. Throws InputError for nodes that are
  /// not as many or not ascending, more unknowns than CHOLMOD can number, or too little memory for the factor;
  /// NumericalError naming the first unknown at which the matrix is not positive definite, or if its pivots span more
  /// than 13 orders of magnitude.
  explicit Cholesky(const SymmetricMatrix& lower, const std::vector<Index>& node_of = {});
  ~Cholesky();
  Cholesky(Cholesky&&) noexcept;
  Cholesky& operator=(Cholesky&&) noexcept;

  /// X with A X = B, one column per right-hand side. Throws InputError if B has not a row for each unknown.
  Matrix solve(const Eigen::Ref<const Matrix>& B) const;
  /// Entries of the factor.
  double factor_entries() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace efree
