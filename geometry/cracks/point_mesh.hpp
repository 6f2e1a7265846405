// SPDX-License-Identifier: GPL-3.0-or-later
/// A mesh between material points: the body that they are, as something one can cut and draw.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <vector>

namespace efree {

/// Vertices of a body that moves as points of it do.
template <int Dim> struct PointMesh {
  Points<Dim> vertices;        ///< in the reference configuration: first the points, in their order, then all others
  Cells<Dim> cells{};          ///< positive, but for rounding in flat ones
  std::vector<Index> owner{};  ///< by vertex: the point that it moves with, a point by itself
  Index num_points = 0;
};

/// The points of a body and points of its surface, about as far apart, joined by Delaunay triangulation (CGAL); cells
/// with their centroid outside the mesh of the body are dropped. What is between two points of the surface that are
/// nearer to each other than points are to their neighbours may be lost, and gaps as narrow be filled. Throws
/// InputError for less than Dim + 1 points. Cost n log n.
template <int Dim> PointMesh<Dim> mesh_between(const Points<Dim>& points, const FineMesh<Dim>& body);
/// Of points alone, whose body ends at the outer ones: cells with an edge longer than three times the distance between
/// neighbours are dropped.
template <int Dim> PointMesh<Dim> mesh_between(const Points<Dim>& points);
/// A mesh whose vertices are the points, vertex by vertex.
template <int Dim> PointMesh<Dim> mesh_of_vertices(const FineMesh<Dim>& mesh);
/// Several bodies as one: points of the first, of the second, ..., then their other vertices.
template <int Dim> PointMesh<Dim> join(const std::vector<PointMesh<Dim>>& meshes);

}  // namespace efree
