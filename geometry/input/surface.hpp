// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies given by triangulated surfaces, clean or dirty.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <array>
#include <string>
#include <vector>

namespace efree {

/// Triangles in space; nothing is said about how they meet.
struct SurfaceSoup {
  Points<3> points;
  std::vector<std::array<Index, 3>> triangles;
};

/// Reads .stl (text or binary), .off, .obj or .ply (CGAL). Coordinates are the file's numbers. Points of the same
/// coordinates are joined, polygons cut into triangles. Throws InputError for a file that is missing, empty, truncated
/// or in another format than its name says, without a triangle, or with a coordinate that is not a finite number.
SurfaceSoup read_surface(const std::string& path);

/// How a surface is meshed.
struct SurfaceMeshOptions {
  double size = 0.0;            ///< longest edge [length]; required
  double feature_angle = 30.0;  ///< edges with a larger angle between the normals of their triangles are kept [degrees]
  double distance = 0.0;        ///< farthest the mesh's boundary may be from the surface [length]; 0: size / 20
};

/// Tetrahedra for the inside of a closed surface (CGAL Mesh_3: Delaunay refinement with protected sharp edges; Rineau &
/// Yvinec 2007, Cheng, Dey & Levine 2008), not optimised, edges longer than `size` split. Shells inside others are
/// cavities; there may be several bodies, which make one region. Triangles may be in any order and orientation. The
/// boundary between sharp edges becomes the groups "surface 1", "surface 2", ..., the largest first. No tetrahedron is
/// as good as without volume (six times it over the cube of the longest edge is 1e-4 at least, before edges are split):
/// such ones are taken off flat sides, or a vertex moves, but no corner: freely inside the body, along the surface, or
/// off it by up to a tenth of `distance` in all; NumericalError with the place where that is not enough. Single thread,
/// deterministic. Throws InputError if the surface is open, meets itself, has three triangles at an edge or encloses no
/// volume (each with the place of the first fault), an option is out of range, or the size is so coarse for thin parts,
/// small radii or cavities that a tenth of the volume would be lost or filled. Slivers lower than the mesh's distance
/// are taken to face as their neighbours do, so that strips of them leave no sharp edges. Known limit: where other
/// sharp edges meet in angles near zero their protection may take minutes; a larger feature_angle, or 180 for none,
/// helps.
MeshData<3> mesh_surface(const SurfaceSoup& soup, const SurfaceMeshOptions& options);

/// How a surface is wrapped.
struct WrapOptions {
  double alpha = 0.0;   ///< holes and gaps narrower than about this are closed [length]; 0: diagonal of the box / 50
  double offset = 0.0;  ///< distance of the wrap from the surface [length]; 0: alpha / 30
};
/// A wrapped surface, and what it encloses.
struct SurfaceWrap {
  SurfaceSoup surface;               ///< closed, oriented, free of self-intersections
  double max_distance = 0.0;         ///< of the wrap's vertices and middles of triangles to the given ones [length]
  double mean_distance = 0.0;        ///< over the area of the wrap
  double volume = 0.0;               ///< enclosed by the wrap
  double alpha = 0.0, offset = 0.0;  ///< as used
};

/// A closed surface around any triangles: holes, self-intersections, gaps, doubled sheets (CGAL Alpha_wrap_3;
/// Portaneri, Rouxel-Labbe, Hemmer, Cohen-Steiner & Alliez 2022). The wrap lies outside; what cannot be reached from
/// outside through openings wider than alpha is filled. Throws InputError for no triangle, a flat box with alpha 0
/// given, lengths that are not positive, or a wrap that encloses nothing but the sheet itself, as thick as the offset
/// makes it.
SurfaceWrap wrap_surface(const SurfaceSoup& surface, const WrapOptions& options = {});

}  // namespace efree
