// SPDX-License-Identifier: GPL-3.0-or-later
/// Built-in solids, meshed with tetrahedra.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree::solids {

// All are made by OpenCASCADE and gmsh's Delaunay mesher, with edges no longer than `size` and at least 16 to a full
// turn of a curved surface; deterministic. Every facet of the boundary is in exactly one group. All throw InputError
// for lengths that make no such shape, negative sizes, and meshes that take more memory than there is. They start a
// gmsh session of their own: not to be called from two threads.

/// Block [0, x] x [0, y] x [0, z] with the sides left, right (x = 0, x), front, back (y), bottom, top (z).
MeshData<3> box(const Vec<3>& lengths, double size);

/// One eighth of a cube of half width `half_width` with a spherical cavity: [0, half_width]^3 less the ball of `radius`
/// at the origin. Groups left, front, bottom (x, y, z = 0, symmetry planes), right, back, top, cavity.
/// 0 < size_at_hole < size: edges no longer than about that at the cavity, growing to `size` within 2 radii.
MeshData<3> spherical_cavity(double radius, double half_width, double size, double size_at_hole = 0.0);

/// Quarter of a thick tube around the z axis, 0 <= z <= height, x, y >= 0. Groups inner, outer, left (x = 0) and front
/// (y = 0), bottom, top.
/// 0 < size_at_inner < size: edges of about that at the inner wall, growing linearly to `size` at the outer one.
MeshData<3> thick_cylinder(double inner, double outer, double height, double size, double size_at_inner = 0.0);

/// One eighth of a thick sphere around the origin, x, y, z >= 0. Groups inner, outer, left, front, bottom (x, y, z =
/// 0). size_at_inner: as for the cylinder.
MeshData<3> thick_sphere(double inner, double outer, double size, double size_at_inner = 0.0);

/// Cylinder around the z axis, 0 <= z <= height. Groups bottom, top, side.
MeshData<3> cylinder(double radius, double height, double size);

}  // namespace efree::solids
