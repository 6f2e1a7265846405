// SPDX-License-Identifier: GPL-3.0-or-later
/// What cells that hold several materials store too little of.
#pragma once

#include "efree/solvers/cells/cell_solver.hpp"

namespace efree::internal {

/// Strains that are continuous in a cell stretch all of its materials alike. In truth tractions are continuous across
/// an interface, and only strains along it: the soft side takes most of the rest. Returns by how much cells with
/// materials of different stiffness are too stiff, as energy [force * length]: at the traction beside the interface and
/// the strains along it, the potential of their mixture less that of layers with the interface's normal (laminates;
/// Backus 1962). To first order the strain energy is off by as much; exact for layers in series. Interfaces within 18
/// degrees of the grid's planes only: others lie differently in each cell, so that a grid of half the edges shows what
/// they cost. `materials` by label. Bitwise the same on any number of threads.
double interface_energy(const CellSolution& solution, const LabelImage<3>& image,
                        const std::vector<SharedMaterial>& materials);

}  // namespace efree::internal
