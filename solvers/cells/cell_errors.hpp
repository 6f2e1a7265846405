// SPDX-License-Identifier: GPL-3.0-or-later
/// How far single values of a solution on cells may be off.
#pragma once

#include "efree/solvers/cells/cell_solver.hpp"

#include <string>

namespace efree {

/// Estimated error of displacement_at(solution, 0, x), component by component [length]: by the three finest grids
/// (Richardson 1911, at a rate between one and two), but at least a sixth of the difference between the second and the
/// third, and a quarter of the relative error of the energy; with what iterations leave and what cells with several
/// materials lack of compliance.
Vec<3> displacement_error_at(const CellSolution& solution, const Vec<3>& x);
/// Likewise of the force that holds a part [force]. Throws std::out_of_range for a part that nothing holds.
Vec<3> reaction_error(const CellSolution& solution, const std::string& on);

}  // namespace efree
