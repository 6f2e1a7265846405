// SPDX-License-Identifier: GPL-3.0-or-later
/// The true, curved surface of a body beside the facets of its mesh.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <numbers>
#include <utility>

namespace efree {

/// Vectors from points of the facets of a mesh to the true surface of the body [length]. The points are vertices and
/// midpoints of edges, in space of the edges of triangles, with exactly the coordinates that the mesh gives them: so
/// the offsets hold for every mesh with these vertices, however it is numbered, cut open or reduced. A point that is
/// not listed lies on the surface.
template <int Dim> struct BoundaryOffsets {
  Points<Dim> points{};
  Points<Dim> offsets{};  ///< column by column
};

/// A mesh, and where the true surface lies beside its facets.
template <int Dim> struct CurvedMesh {
  MeshData<Dim> mesh;
  BoundaryOffsets<Dim> boundary{};
  int order = 1;  ///< highest order of the elements that were read; their corner nodes are the vertices

  operator MeshData<Dim>() const& { return mesh; }
  operator MeshData<Dim>() && { return std::move(mesh); }
};

/// The point of an edge that BoundaryOffsets names it by.
template <int Dim> Vec<Dim> edge_midpoint(const Vec<Dim>& a, const Vec<Dim>& b) {
  return 0.5 * (a + b);
}

/// Number of points that a quadratic polynomial on a facet is given by.
template <int Dim> inline constexpr int facet_points = Dim == 2 ? 3 : 6;

/// Vectors from boundary facets to the true surface [length]: (Dim * facet_points) x num_facets, at the vertices of
/// each facet, then at the midpoints of its edges ((0, 1), in space also (0, 2), (1, 2)), one below the other. Facets
/// that share an edge share its offsets, so that quadratic polynomials between them make a continuous surface.
template <int Dim> Matrix facet_offsets(const FineMesh<Dim>& mesh, const BoundaryOffsets<Dim>& boundary);

/// Their components along the outward normals, positive where the body reaches beyond the facet [length]: facet_points
/// x num_facets.
template <int Dim> Matrix normal_offsets(const FineMesh<Dim>& mesh, const Matrix& offsets);
/// The largest of these on each facet, without sign [length].
template <int Dim> Vector sagittas(const FineMesh<Dim>& mesh, const Matrix& offsets);

/// Facets that meet at a smaller angle are taken for those of a smooth surface [radians].
inline constexpr double largest_smooth_angle = 40.0 * std::numbers::pi / 180.0;

/// Offsets where nothing is known of the surface: as if it were smooth wherever facets meet at less than
/// largest_smooth_angle, but for sides of one plane that are four times as wide as their neighbours. Vertices lie on
/// it; its normals there are the means of those of the facets around (Max 1999).
template <int Dim> BoundaryOffsets<Dim> smooth_offsets(const FineMesh<Dim>& mesh);

/// All lengths times a factor > 0.
template <int Dim> CurvedMesh<Dim> scaled(CurvedMesh<Dim> curved, double factor);

/// split_long_edges with the offsets of the facets' halves, which stay where the facet was: those of points on
/// quadratic facets. Facets that belong to no group have offsets along split edges only.
template <int Dim> CurvedMesh<Dim> split_long_edges(CurvedMesh<Dim> curved, double longest);

}  // namespace efree
