// SPDX-License-Identifier: GPL-3.0-or-later
/// Velocities of the grid's nodes where those of material points are prescribed.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"

namespace efree::internal {

/// Finds World::prescribed by World::prescribed_points: of nodes that have half of their mass and more from these. The
/// field is affine around each point (as of Transfer::apic): up to the edge of a body, a rotation stays one.
template <int Dim> void find_prescribed_nodes(World<Dim>& world, PointGrid<Dim>& grid);

}  // namespace efree::internal
