// SPDX-License-Identifier: GPL-3.0-or-later
/// Shape functions of the grid's nodes on the surface of bodies, for loads there.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"

#include <vector>

namespace efree::internal {

/// K x N, shape functions of the nodes of a body at each position (Dim x K) on its surface: moving least squares with
/// splines for weights. Nodes beyond the surface, to which points give little mass, get less, in proportion to it.
/// Where the body is a mesh (is_mesh, by body), whose vertices carry mass at the surface, splines.
template <int Dim> SparseRows functions_on_grid(const World<Dim>& world, const PointGrid<Dim>& grid,
                                                const std::vector<char>& is_mesh, const Points<Dim>& at,
                                                const std::vector<Index>& bodies);

}  // namespace efree::internal
