// SPDX-License-Identifier: GPL-3.0-or-later
/// What grids of cells leave of the energy.
#pragma once

#include "efree/solvers/cells/cell_solver.hpp"

namespace efree::internal {

/// Fills grid_error, interface_error and extrapolated_energy of a solution by its levels: from the last two at the rate
/// of the last three.
void estimate_errors(CellSolution& solution);

}  // namespace efree::internal
