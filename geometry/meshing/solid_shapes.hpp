// SPDX-License-Identifier: GPL-3.0-or-later
/// Built-in solids, meshed with tetrahedra.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"

namespace efree::solids {

// All are made by OpenCASCADE and gmsh's Delaunay mesher, with edges no longer than `size` and at least 16 to a full
// turn of a curved surface; deterministic. `sagitta` > 0: fine enough too that facets are no farther from a curved
// surface than this fraction of the thickness of the wall, or of the radius of curvature if that is less (for nearly
// all facets, and at most 60 000 that only this asks for). Every facet of the boundary is in exactly one group. All
// throw InputError for lengths that make no such shape, negative sizes, and meshes that take more memory than there is.
// They start a gmsh session of their own: not to be called from two threads.

/// Block [0, x] x [0, y] x [0, z] with the sides left, right (x = 0, x), front, back (y), bottom, top (z).
MeshData<3> box(const Vec<3>& lengths, double size);

/// One eighth of a cube of half width `half_width` with a spherical cavity: [0, half_width]^3 less the ball of `radius`
/// at the origin. Groups left, front, bottom (x, y, z = 0, symmetry planes), right, back, top, cavity.
/// 0 < size_at_hole < size: edges no longer than about that at the cavity, growing to `size` within 2 radii.
CurvedMesh<3> spherical_cavity(double radius, double half_width, double size, double size_at_hole = 0.0,
                               double sagitta = 0.0);

/// Quarter of a thick tube around the z axis, 0 <= z <= height, x, y >= 0. Groups inner, outer, left (x = 0) and front
/// (y = 0), bottom, top.
/// 0 < size_at_inner < size: edges of about that at the inner wall, growing linearly to `size` at the outer one.
CurvedMesh<3> thick_cylinder(double inner, double outer, double height, double size, double size_at_inner = 0.0,
                             double sagitta = 0.0);

/// One eighth of a thick sphere around the origin, x, y, z >= 0. Groups inner, outer, left, front, bottom (x, y, z =
/// 0). size_at_inner: as for the cylinder.
CurvedMesh<3> thick_sphere(double inner, double outer, double size, double size_at_inner = 0.0, double sagitta = 0.0);

/// Cylinder around the z axis, 0 <= z <= height. Groups bottom, top, side.
CurvedMesh<3> cylinder(double radius, double height, double size, double sagitta = 0.0);

/// Half of a ring with a round section around the z axis, y >= 0: radius of the circle of centres and of the section.
/// Groups start (x > 0) and end (x < 0), both in y = 0, and surface.
CurvedMesh<3> half_torus(double radius, double section, double size, double sagitta = 0.0);

}  // namespace efree::solids
