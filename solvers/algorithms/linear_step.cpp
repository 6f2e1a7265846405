// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/linear_step.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/finite.hpp"
#include "efree/solvers/algorithms/newton.hpp"

#include <fmt/format.h>

namespace efree {

State linear_step(const Equations& equations, const LinearSolver& tangent, State from, double factor) {
  return std::move(linear_steps({&equations}, tangent, from, factor).front());
}

std::vector<State> linear_steps(const std::vector<const Equations*>& equations, const LinearSolver& tangent,
                                const State& from, double factor) {
  constexpr double largest = 1e-6;
  std::vector<State> states;
  Matrix forces;
  for (std::size_t k = 0; k < equations.size(); ++k) {
    states.push_back(equations[k]->under(factor, from));
    const Vector residual = equations[k]->residual(states.back());
    if (k == 0) forces.resize(residual.size(), static_cast<Index>(equations.size()));
    forces.col(static_cast<Index>(k)) = -residual;
  }
  const Matrix changes = tangent.solve(forces);
  if (!internal::all_finite(changes)) throw NumericalError("the solution is not finite");
  for (std::size_t k = 0; k < equations.size(); ++k) {
    states[k] = equations[k]->moved(std::move(states[k]), changes.col(static_cast<Index>(k)));
    if (equations[k]->linear()) continue;
    const OutOfBalance out(equations[k]->residual(states[k]), equations[k]->force_scale(states[k]));
    if (!(out.share <= largest))
      throw NumericalError(
          fmt::format("one linear step leaves forces of {:.2g} out of balance where {:.2g} act: the materials are not "
                      "linear at these strains",
                      out.force, out.scale));
  }
  return states;
}

}  // namespace efree
