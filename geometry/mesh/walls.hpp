// SPDX-License-Identifier: GPL-3.0-or-later
/// How thick a body is below its boundary.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree {

/// Thickness of the body below every boundary facet [length]: along the inward normal from near its middle to where the
/// body ends, in a mesh parted by cut_regions where the region ends; exact, as the mesh is walked through cell by cell.
/// Infinite where the far side does not face the near one (normals more than 37 degrees from opposite): the sides of a
/// corner are no wall. Cost: the cells that are walked through.
template <int Dim> Vector wall_thickness(const FineMesh<Dim>& mesh);

/// Thickness that this share of the boundary above walls, by its measure, falls below [length]; infinity without walls.
template <int Dim> double thin_wall(const FineMesh<Dim>& mesh, double share);

}  // namespace efree
