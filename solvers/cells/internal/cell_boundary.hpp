// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of an image's boundary on grids of cells.
#pragma once

#include "efree/geometry/input/image_boundary.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// What a part of the boundary has in an octant of a cell, of the facets that face one way.
struct BoundaryPatch {
  std::array<Index, 3> octant;  ///< two to a cell along each axis
  int side;                     ///< the way they face, as VoxelFacet::side
  bool on_frame;
  double facet_area;  ///< of the faces of voxels [length^2]
  double area;        ///< of the surface that they stand for, of which they are the steps
  Vec<3> at;          ///< their centroid, from the image's origin along its axes
  Vec<3> normal;      ///< mean outward unit normal of that surface, along the axes of the image; its length <= 1

  std::array<Index, 3> cell() const { return {octant[0] / 2, octant[1] / 2, octant[2] / 2}; }
  /// The nearest node.
  std::array<Index, 3> node() const { return {(octant[0] + 1) / 2, (octant[1] + 1) / 2, (octant[2] + 1) / 2}; }
  /// Of the faces of voxels, along the axes of the image.
  Vec<3> facet_normal() const { return (side % 2 == 1 ? 1.0 : -1.0) * Vec<3>::Unit(side / 2); }
};

/// Patches of facets on a grid of so many cells, with how much of each octant is material (`solid`, two to a cell along
/// each axis, x fastest). Where boundaries within voxels leave the cell of a facet hardly any, the patch is in the next
/// one inwards that has some; facets that have none are left out.
std::vector<BoundaryPatch> boundary_patches(const LabelImage<3>& image, const std::vector<VoxelFacet>& facets,
                                            const std::vector<float>& solid, const std::array<Index, 3>& cells);

/// Patches on a coarser grid, from those of the next finer one, `ratio` (1 or 2) of whose cells are one along each
/// axis. Areas and moments stay.
std::vector<BoundaryPatch> coarsened(const std::vector<BoundaryPatch>& patches, const std::array<int, 3>& ratio);

}  // namespace efree::internal
