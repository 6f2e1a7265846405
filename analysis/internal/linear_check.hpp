// SPDX-License-Identifier: GPL-3.0-or-later
/// Whether linear elasticity does where materials can do more.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/algorithms/newton.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"
#include "efree/solvers/linear/cholesky.hpp"

namespace efree::internal {

/// The linear model beside the full one, on the same functions and points.
template <int Dim> class LinearBeside {
 public:
  /// Refers to the equations.
  LinearBeside(const NonlinearEquilibrium<Dim>& full, double tolerance)
      : full_(full), linear_(full.at_rest()), tangent_(full_, factor_), tolerance_(tolerance) {}
  LinearBeside(const LinearBeside&) = delete;

  const NonlinearEquilibrium<Dim>& equations() const { return linear_; }
  /// Of a state in balance of the linear equations. What the full ones do not balance there costs a tangent and its
  /// factor; where they agree to rounding there is nothing to factor.
  LinearCheck operator()(const State& at);
  /// That state as one of the full equations, not committed.
  State as_full(const State& at) const;

 private:
  const NonlinearEquilibrium<Dim>& full_;
  const NonlinearEquilibrium<Dim> linear_;
  Cholesky factor_;
  TangentSolver tangent_;
  double tolerance_;
};

/// The check of loads that act at once, on result.approximation. Stage "model".
template <int Dim>
LinearCheck check_linear(const Settings<Dim>& full, const Result<Dim>& result, const Monitor& monitor);

/// Warns if a linear answer, which may be corrected, has stresses beyond the tolerance of what the full model's
/// materials bear.
template <int Dim> void warn_of_overload(const Settings<Dim>& settings, const ElasticModel& full, Result<Dim>& result);

}  // namespace efree::internal
