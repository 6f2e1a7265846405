// SPDX-License-Identifier: GPL-3.0-or-later
/// The smooth surface that a triangulated one approximates, beside the mesh that was made of it.
#pragma once

#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/mesh/boundary_offsets.hpp"

namespace efree {

/// Offsets of the boundary of a mesh from the surface that it was made of, taken to be smooth where its triangles meet
/// at less than `largest_angle` [radians], as smooth_offsets has it: so they hold what facets of the mesh leave of the
/// triangles, and what these leave of the surface that was exported. Vertices and midpoints farther than `reach`
/// [length] from triangles that face alike have none, such as those that close holes. None at all for a body of planes
/// whose sides the facets lie in. The surface may be dirty. Cost n log n in facets and triangles; the same on any
/// number of threads.
BoundaryOffsets<3> surface_offsets(const FineMesh<3>& mesh, const SurfaceSoup& surface, double largest_angle,
                                   double reach);

}  // namespace efree
