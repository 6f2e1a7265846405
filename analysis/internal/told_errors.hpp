// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of the single numbers that settings ask for.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <functional>

namespace efree::internal {

/// Load cases, or dual solutions, that are worked out at a time: they share what is read of the matrix, and more only
/// take memory.
constexpr std::size_t cases_together = 16;

/// The finite elements that answers are of, or are compared with.
template <int Dim> struct Reference {
  const Approximation<Dim>& elements;
  std::vector<const Fields<Dim>*> fields;  ///< recovered, of their solutions for the first load cases, or all
  bool weakly;                             ///< every condition is set by Nitsche
  /// The displacements of dual solutions.
  std::function<std::vector<Points<Dim>>(const std::vector<Functional<Dim>>&, const Monitor&)> duals;
  /// A functional for the solution of a load case.
  std::function<double(const Functional<Dim>&, const Points<Dim>& dual, std::size_t)> value;
};

/// Whether there are errors to be told by dual solutions.
template <int Dim> bool asks_for_errors(const Settings<Dim>& settings);

/// Probes, and the extremes, as the fields of the answer have them.
template <int Dim> void read_off(const Settings<Dim>& settings, const FineSpace<Dim>& space, Answer<Dim>& answer);

/// Errors of probes, reactions and extremes of the answers in the result that the reference has solutions for, and the
/// reactions: by a dual solution for each component (stage "duals"), which serves all load cases; of the largest
/// displacement each has its own. The displacements are those of the answers' fields.
template <int Dim> void tell_errors(const Settings<Dim>& settings, const Reference<Dim>& reference, Result<Dim>& result,
                                    const Monitor& monitor);
/// The same on cells, from what the three finest grids have; probes and extremes are in the answer.
void tell_errors_on_cells(const Settings<3>& settings, const CellSolution& cells, Answer<3>& answer);

/// By cell of the fine mesh: distance between recovered stress and that of the displacement, in the energy norm,
/// relative to the mean energy density of the body. `squares`: by cell, of that distance [force * length].
template <int Dim> Vector error_density(const Result<Dim>& result, const Vector& squares);

/// Error of a probe or reaction relative to its size; 1 if it is not known.
template <int Dim> double relative_error_of(const Goal& goal, const Answer<Dim>& answer);

/// By how much the goals are missed: the largest of their errors relative to what is wanted, as a root, since
/// such errors behave like squares of those in the energy norm. 0 without goals.
template <int Dim> double missed_goals(const Settings<Dim>& settings, const Answer<Dim>& answer);

}  // namespace efree::internal
