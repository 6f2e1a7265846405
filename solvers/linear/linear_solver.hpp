// SPDX-License-Identifier: GPL-3.0-or-later
/// The one seam between equations and the libraries that solve linear systems.
#pragma once

#include "efree/assembly/operators.hpp"

#include <vector>

namespace efree {

/// A solver of sparse symmetric systems. The pattern is analysed once, values are factored as often as they
/// change, and any number of threads may solve with the last factor at once.
class LinearSolver {
 public:
  virtual ~LinearSolver() = default;

  /// Orders the unknowns of a pattern (lower triangle, values do not count). `node_of` numbers the node of each
  /// unknown, ascending: then nodes are ordered, not unknowns, which is several times faster and as good. Without it
  /// every unknown is a node.
  virtual void analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of = {}) = 0;
  /// Factors a matrix with that pattern, positive definite or not. Throws NumericalError naming the unknown if a pivot
  /// is zero, or if pivots span more than 13 orders of magnitude.
  virtual void factorize(const SymmetricMatrix& lower) = 0;
  /// Of the last factor: 0 if the matrix is positive definite, else the number of its negative eigenvalues (Sylvester's
  /// law of inertia).
  virtual Index negative_pivots() const = 0;
  /// X with A X = B, to rounding unless the solver says otherwise, one column per right-hand side. Throws InputError if
  /// B has not a row for each unknown.
  virtual Matrix solve(const Eigen::Ref<const Matrix>& B) const = 0;
};

}  // namespace efree
