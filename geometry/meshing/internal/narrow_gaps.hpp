// SPDX-License-Identifier: GPL-3.0-or-later
/// Gaps within a body that are narrower than a Delaunay mesh resolves.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <array>
#include <set>

namespace efree::internal {

/// Gaps narrower than this share of the mesh size have no sharp rims: Mesh_3 covers sharp edges with balls smaller than
/// the distance between them, which takes a time inverse to it.
constexpr double narrow_share = 0.4;

/// Edges of a closed, outward surface, as pairs of points in ascending order, beside which a triangle faces another one
/// across a gap narrower than `width` [length]; and edges shorter than that between points of these. Looked for at
/// points of each edge at most half of `size` [length] apart.
std::set<std::array<Index, 2>> rims_of_gaps(const SurfaceSoup& surface, double width, double size);

/// Throws InputError with place and width for gaps of a body that a mesh with these options would neither resolve nor
/// close, if they would make it take more than twice as long: wider than the distance that a mesh may be off the
/// surface they are meshed on both sides, with triangles as small as they are wide. `enclosed`: volume of all bodies.
void refuse_costly_gaps(const SurfaceSoup& body, double enclosed, const SurfaceMeshOptions& options);

}  // namespace efree::internal
