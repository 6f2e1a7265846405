// SPDX-License-Identifier: GPL-3.0-or-later
/// The simplest algorithm: one step of Newton's method, which solves linear equations.
#pragma once

#include "efree/solvers/equations/equations.hpp"
#include "efree/solvers/linear/linear_solver.hpp"

#include <vector>

namespace efree {

/// The state under a factor, from another one, by one solve with a factored tangent of the equations. Throws
/// NumericalError if the result is not finite, or if it leaves forces out of balance because the equations are not
/// linear.
State linear_step(const Equations& equations, const LinearSolver& tangent, State from, double factor = 1.0);

/// The same for several equations that have this tangent in common and differ in what acts: all solved together.
std::vector<State> linear_steps(const std::vector<const Equations*>& equations, const LinearSolver& tangent,
                                const State& from, double factor = 1.0);

}  // namespace efree
