// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear_step.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>

namespace efree {

State linear_step(const Equations& equations, const LinearSolver& tangent, State from, double factor) {
  State state = equations.under(factor, std::move(from));
  const Vector change = tangent.solve(-equations.residual(state));
  if (!change.allFinite()) throw NumericalError("the solution is not finite");
  state = equations.moved(std::move(state), change);
  if (equations.linear()) return state;
  constexpr double largest = 1e-6;
  const double left = equations.residual(state).lpNorm<Eigen::Infinity>(), scale = equations.force_scale(state);
  if (!(left <= largest * scale))
    throw NumericalError(
        fmt::format("one linear step leaves forces of {:.2g} out of balance where {:.2g} act: the materials are not "
                    "linear at these strains",
                    left, scale));
  return state;
}

}  // namespace efree
