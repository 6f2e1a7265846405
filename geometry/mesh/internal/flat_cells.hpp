// SPDX-License-Identifier: GPL-3.0-or-later
/// Tetrahedra as good as without volume, which Delaunay refinement makes of four points of a plane.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <vector>

namespace efree::internal {

/// Dim! times the signed volume of a cell over that power of its longest edge: 0.87 in the plane and 0.71 in space if
/// it is regular, 1e-16 or so if rounding is all that it has.
template <int Dim> double flatness(const Points<Dim>& vertices, const Cells<Dim>& cells, Index c);

/// The condition of P1's stiffness is no better than the inverse of the least flatness. Meshes have 2e-3 of their own.
constexpr double least_flatness = 1e-4;

/// Takes away cells below `least_flatness` that lie on the boundary with two facets of one group: their other two
/// facets take the place of those. Cells with a ridge on the boundary already stay, the body would be pinched.
void peel_flat_cells(MeshData<3>& mesh);

/// Moves vertices of cells below `least_flatness` until none is: inside the body, in flat sides or along straight edges
/// as far as it serves the cells around, which leaves the boundary and the interfaces between regions where they are;
/// if that does not help, any vertex off the surface, in all by at most `reach` [length]. Those inside the body, which
/// are free already, may move further. `is_fixed`, by vertex: not to be moved.
/// Of all moves tried for a cell, that is taken which leaves the least flat of the cells around it the best (Freitag
/// and Ollivier-Gooch 1997). Deterministic. Throws NumericalError with the place of a cell that nothing helps.
void inflate_flat_cells(MeshData<3>& mesh, double reach, const std::vector<char>& is_fixed);

}  // namespace efree::internal
