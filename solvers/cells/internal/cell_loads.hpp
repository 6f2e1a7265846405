// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on grids of cells.
#pragma once

#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <array>
#include <string>
#include <vector>

namespace efree::internal {

/// Names of the sides of an image's frame, by 2 axis, plus 1 at the upper end.
const std::array<std::string, 6>& side_names();

/// A place in messages.
std::string text_of(const Vec<3>& x);

/// Adds the work-equivalent forces of all loads on the boundary, unscaled, on what its parts have in each octant.
/// Tractions are taken to be linear in the normal: they get a vector that times the area of the surface is that of the
/// faces of voxels, whose sum is exact. Returns what each load is. Throws InputError for loads that are not finite.
std::vector<AppliedLoad<3>> add_loads(const CellProblem& problem, const Loads<3>& loads, const PartPatches& patches,
                                      Field& to);

}  // namespace efree::internal
