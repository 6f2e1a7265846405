// SPDX-License-Identifier: GPL-3.0-or-later
/// Polygons with holes, inner constraints and slits, and their careless triangulation.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace efree {

/// An open or closed chain of straight segments with the name its boundary facets get (may be empty).
struct Polyline {
  std::string name;
  std::vector<Vec<2>> points;  ///< repeat the first point at the end to close it
  /// By segment: from its middle to the curve that it is a chord of [length]; empty: the segments are the boundary.
  std::vector<Vec<2>> bulges{};
};

/// A planar domain: the points with an odd number of boundary segments on a ray to infinity (outlines and holes in any
/// order and direction). Points closer than 1e-12 of the domain's extent are one point, and a point that close to a
/// segment lies on it. Segments given twice cancel: a line between two parts of the body is no boundary.
struct PlanarDomain {
  std::vector<Polyline> boundary{};
  /// Chains of segments that fine edges must follow, or single points that must be fine vertices. A name goes to those
  /// of their facets that lie on the boundary, so a facet can have several names.
  std::vector<Polyline> embedded{};
  /// Chains the body is cut open along; their ends are tips unless on the boundary or on each other. They may cross
  /// each other and embedded chains.
  std::vector<Polyline> slits{};
};

/// How fine a triangulation is.
struct TriangulateOptions {
  double size = 0.0;        ///< longest edge allowed [length]; required
  double min_angle = 20.7;  ///< [degrees] angle that refinement aims at, at most 20.7; 0 leaves slivers alone
};

/// Constrained Delaunay triangulation refined to `size` (CGAL Delaunay_mesher_2; Shewchuk 2002), starting from a
/// jittered lattice inside. Segments are split where needed, so that chains with the same name together are one group.
/// About 3.5 area / size^2 triangles, more around features smaller than `size`. Deterministic; about 0.2 s for 1e5
/// triangles, linear up to 1e6. Throws InputError for open boundaries, boundaries that cross anything, fewer than three
/// points, a slit outside the body, a size that is not positive, or an empty domain.
FineMesh<2> triangulate(const PlanarDomain& domain, const TriangulateOptions& options);
/// The same before it is checked: its groups still hold the edges inside the body that embedded chains became.
MeshData<2> triangulate_data(const PlanarDomain& domain, const TriangulateOptions& options);
/// The same with the offsets of its facets from the curves of the domain. Segments are split on their chords.
CurvedMesh<2> triangulate_curved(const PlanarDomain& domain, const TriangulateOptions& options);

/// Built-in domains. Curves are sampled with chords no longer than `size`, at least 16 to a full turn. With `sagitta`
/// > 0 they are no farther from their arcs than this fraction of the thickness of the wall beside the arc, or of its
/// radius if that is less. All throw InputError for lengths that make no such shape.
namespace shapes {

/// Sides named left, right, bottom, top.
PlanarDomain rectangle(double x0, double y0, double x1, double y1);
/// Quarter of a plate, x, y in [0, half_width], hole of `radius` at the origin; sides left (x = 0), bottom (y = 0),
/// right, top, hole.
PlanarDomain quarter_plate_with_hole(double radius, double half_width, double size, double sagitta = 0.0);
/// [0, 1]^2 times `side` without its upper right quarter; sides left, bottom, right, top, notch.
PlanarDomain l_shape(double side);
/// Cook's membrane (0,0) (48,44) (48,60) (0,44); sides left, bottom, right, top.
PlanarDomain cook();
/// Sides inner, outer.
PlanarDomain annulus(double inner, double outer, double size, double sagitta = 0.0);
/// Rectangle with a straight slit from a to b, named slit.
PlanarDomain slit_rectangle(double x0, double y0, double x1, double y1, Vec<2> a, Vec<2> b);
/// Square [0, width]^2 with `count` circular holes, radii uniform in [r_min, r_max], gaps (to sides too) at least
/// `gap`; sides left, bottom, right, top, holes. Random sequential placement, reproducible by seed; throws InputError
/// if they do not fit.
PlanarDomain plate_with_random_holes(double width, int count, double r_min, double r_max, double gap,
                                     std::uint64_t seed, double size, double sagitta = 0.0);

}  // namespace shapes
}  // namespace efree
