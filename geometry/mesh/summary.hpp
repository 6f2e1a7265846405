// SPDX-License-Identifier: GPL-3.0-or-later
/// What a mesh is made of: bodies, named parts of the boundary, smallest features.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace efree {

/// Smallest axis-parallel box.
template <int Dim> using BoundingBox = Eigen::AlignedBox<double, Dim>;

/// A region.
template <int Dim> struct BodySummary {
  std::string name;  ///< "" if it has none
  Index num_cells = 0;
  double volume = 0.0;  ///< area in 2D
  BoundingBox<Dim> box;
};

/// A named set of facets, on the boundary or inside.
template <int Dim> struct GroupSummary {
  std::string name;
  Index num_facets = 0;
  double measure = 0.0;  ///< area, length in 2D
  /// Unit normal if the group is flat: no facet's normal is off by more than 0.1 degrees. Outward if it lies on the
  /// boundary, between two regions out of the one with the smaller number, else of either sign.
  std::optional<Vec<Dim>> normal;
  BoundingBox<Dim> box;
  /// The mean of these normals over the group: of length 1 if it is flat, 0 if it goes all around.
  Vec<Dim> mean_normal = Vec<Dim>::Zero();
};

/// What a mesh holds.
template <int Dim> struct GeometrySummary {
  std::vector<BodySummary<Dim>> bodies;   ///< by region; one without a name if the mesh has no regions
  std::vector<GroupSummary<Dim>> groups;  ///< in the mesh's order
  Index num_vertices = 0, num_cells = 0;
  double volume = 0.0;    ///< area in 2D
  double boundary = 0.0;  ///< area of the boundary, length in 2D
  BoundingBox<Dim> box;
  double smallest_edge = 0.0, largest_edge = 0.0;
  double smallest_angle = 0.0;  ///< in a triangle, dihedral in a tetrahedron [degrees]
  Index num_components = 0;     ///< parts of the mesh that share no vertex
};

/// Throws InputError for what FineMesh refuses. Linear in the mesh.
template <int Dim> GeometrySummary<Dim> summarize(const MeshData<Dim>& mesh);

}  // namespace efree
