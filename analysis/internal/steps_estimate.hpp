// SPDX-License-Identifier: GPL-3.0-or-later
/// What steps through time lead to, and how far those of a cloud are from the finite elements of its fine mesh.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/elements_beside.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Strains and stresses where they live, from the `points` of a state.
template <int Dim>
Solution<Dim> solution_of(const NonlinearEquilibrium<Dim>& equations, const State& state, PointFields<Dim>& points) {
  const auto& approximation = equations.approximation();
  return {state.u.reshaped(Dim, approximation.shape.num_nodes()), std::move(points.strain), std::move(points.stress),
          approximation.quadrature.weights.dot(points.energy)};
}

/// Puts the error of a cloud's last state into the result, which has its fields and history, and, of bodies whose
/// answer is to be corrected, the state of the elements in its place. Why the error is not known; nothing where it is.
template <int Dim> std::string estimate_steps(const Settings<Dim>& settings, Program<Dim> program, const State& last,
                                              Result<Dim>& result, const Monitor& monitor);

/// The times of the steps of a path.
template <int Dim> std::vector<double> times_of(const Result<Dim>& result);
/// Puts the errors of the path, by a coarser one of the same settings, into the result. Why they are unknown; nothing
/// where they are known.
template <int Dim>
std::string compare_paths(const Settings<Dim>& settings, const Result<Dim>& coarser, Result<Dim>& result);
/// The same by Steps::coarser, or by a coarser cloud, which is solved.
template <int Dim>
std::string estimate_path(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor);

}  // namespace efree::internal
