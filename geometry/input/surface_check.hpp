// SPDX-License-Identifier: GPL-3.0-or-later
/// What is right and wrong with a triangulated surface.
#pragma once

#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/input/surface_gaps.hpp"
#include "efree/geometry/mesh/summary.hpp"

#include <optional>
#include <string>
#include <vector>

namespace efree {

/// What is wrong with a surface, and how fine it is.
struct SurfaceCheck {
  BoundingBox<3> box;
  Index triangles = 0, points = 0;  ///< of the soup
  Index degenerate = 0;             ///< triangles without area
  Index open_edges = 0;             ///< with one triangle
  Index crowded_edges = 0;          ///< with more than two
  Index shells = 0;                 ///< parts that share no point
  Index crossings = 0;              ///< pairs of triangles that meet elsewhere than at a common edge or point
  double area = 0.0;
  double shortest_edge = 0.0, longest_edge = 0.0;  ///< of triangles with area
  std::string fault{};                             ///< why mesh_surface would refuse it; empty if it would not
  double volume = 0.0;                             ///< enclosed, if there is no fault
  /// Parts between sharp edges, named as by mesh_surface (but for strips of slivers, which it joins to their
  /// neighbours): "surface 1" is the largest. Outward if there is no fault, else as the triangles are given.
  std::vector<GroupSummary<3>> groups;
  SurfaceSoup surface;          ///< what the groups are made of: turned outward if there is no fault
  std::vector<Index> group_of;  ///< of each triangle of `surface`
  /// The thinnest of its walls.
  struct Wall {
    double thickness;
    Vec<3> at;  ///< on one of its sides
  };
  /// Least distance between triangles that face each other through the body, from the middle of one along its normal;
  /// none if there is a fault.
  std::optional<Wall> thinnest{};
  /// Gaps narrower than default_surface_size, of surfaces with faults, too.
  std::vector<SurfaceGap> gaps{};
};

/// Mesh size of a surface where none is given: diagonal of its box / 40 [length].
double default_surface_size(const SurfaceSoup& soup);

/// Sharp edges have a larger angle than `feature_angle` [degrees] between the normals of their triangles. Throws
/// InputError if there is no triangle, or one names a point that is not there. Cost n log n in the triangles.
SurfaceCheck check_surface(const SurfaceSoup& soup, double feature_angle = 30.0);

}  // namespace efree
