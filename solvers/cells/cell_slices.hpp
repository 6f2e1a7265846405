// SPDX-License-Identifier: GPL-3.0-or-later
/// Numbers of a solution on cells, slice by slice.
#pragma once

#include "efree/solvers/cells/cell_fields.hpp"

#include <array>
#include <vector>

namespace efree {

/// One layer of cells across an axis of the image.
struct CellSlice {
  double at = 0.0;                     ///< of its middle, along the axis from the image's corner [length]
  double solid = 0.0;                  ///< part of its volume that is material
  Voigt<3> stress = Voigt<3>::Zero();  ///< mean over the material, in the world's axes; 0 where there is none
  double von_mises = 0.0, most = 0.0;  ///< mean over the material, and the largest mean of a cell
};

/// Of the axes of the image, from its corner on. `grid`: of the solution. Bitwise the same on any number of threads.
std::array<std::vector<CellSlice>, 3> cell_slices(const Lattice& grid, const CellFields& fields);

}  // namespace efree
