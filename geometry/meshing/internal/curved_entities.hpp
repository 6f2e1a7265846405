// SPDX-License-Identifier: GPL-3.0-or-later
/// Curves and surfaces that gmsh holds, beside the facets that it made of them.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"
#include "efree/geometry/meshing/internal/gmsh_session.hpp"

#include <functional>
#include <map>
#include <vector>

namespace efree::internal {

/// An edge of the boundary's mesh that is no part of its curve or surface.
template <int Dim> struct CurvedEdge {
  Vec<Dim> a, b;    ///< ends, as GmshNodes gives them
  Vec<Dim> offset;  ///< from the midpoint to the curve or surface
  int entity;       ///< curve (2D) or surface it belongs to, where it belongs to two the first
};

/// The curved edges of the mesh in the session: in 2D those of curves, by tangents at their ends; in space those of
/// triangles, by the normals of the surface at their ends (a cubic polynomial each). An edge between two surfaces has
/// the offset that agrees with both. Entities that gmsh has no parameters for have none.
template <int Dim> std::vector<CurvedEdge<Dim>> curved_edges(const GmshSession& session);

/// As offsets of a mesh whose coordinates were divided by `unit`.
template <int Dim> BoundaryOffsets<Dim> offsets_of(const std::vector<CurvedEdge<Dim>>& edges, double unit = 1.0);

/// By curved entity (curves in 2D, surfaces in space): chords with which sagittas are `sagitta` times the thickness of
/// the wall, or the radius of curvature if that is less, on all but the closest twentieth of it. The mesh, from the
/// same session, tells the thickness.
template <int Dim> std::map<int, double> chords_of_walls(const MeshData<Dim>& mesh,
                                                         const std::vector<CurvedEdge<Dim>>& edges, double sagitta);

/// Calls mesh(), which fills the session, and reads that by make(). With `sagitta` > 0, where that fails once more with
/// 64 elements to a full turn: in thin walls facets of one side may lie beyond the other. Then, if chords_of_walls asks
/// for much finer ones than there are, again with these, of which all together at most 60 000 facets are made. Throws
/// as mesh and make do.
template <int Dim> void mesh_with_walls(const GmshSession& session, double sagitta, const std::function<void()>& mesh,
                                        const std::function<MeshData<Dim>()>& make);

}  // namespace efree::internal
