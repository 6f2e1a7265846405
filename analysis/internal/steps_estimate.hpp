// SPDX-License-Identifier: GPL-3.0-or-later
/// How far steps through time of a cloud are from the finite elements of its fine mesh.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/elements_beside.hpp"

namespace efree::internal {

/// Puts the error of a cloud's last state into the result, which has its fields and history, and, of bodies whose
/// answer is to be corrected, the state of the elements in its place; a warning where the error is not known.
template <int Dim> void estimate_steps(const Settings<Dim>& settings, Program<Dim> program, const State& last,
                                       Result<Dim>& result, const Monitor& monitor);

}  // namespace efree::internal
