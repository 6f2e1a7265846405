// SPDX-License-Identifier: GPL-3.0-or-later
/// The smooth surface that facets approximate, where nothing else is known of it.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree::internal {

/// Unit normals of the smooth surface at the corners of facets: (Dim * Dim) x facets.cols(), corner by corner; those of
/// the facet itself where it is flat, and for facets without area zero. At a corner the facets count that face within
/// `largest_angle` [radians] of the facet itself, weighted as is exact for circles and spheres (Max 1999). Where facets
/// of one plane are more than four times as wide as others the surface is tangent to that plane: a flat side is not
/// bent by the narrow facets of a fillet beside it. `facets`: turned alike, at least around each point.
template <int Dim> Matrix smooth_normals(const Points<Dim>& points, const Facets<Dim>& facets, double largest_angle);

/// Vector from the middle of the edge between two points of such a surface to the surface [length], by its normals
/// there. A normal that has no slope along the edge, beside one that has, is that of an end of the surface, where there
/// are facets on one side only: the surface is as curved there as at the other end.
template <int Dim>
Vec<Dim> edge_offset(const Vec<Dim>& a, const Vec<Dim>& b, const Vec<Dim>& normal_at_a, const Vec<Dim>& normal_at_b);

}  // namespace efree::internal
