// SPDX-License-Identifier: GPL-3.0-or-later
/// A plane cut into faces that know their regions: what contours of images are triangulated from.
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"

#include <string>
#include <vector>

namespace efree::internal {

/// Chains meet at points that they share by number, and nowhere else.
struct PlanarRegions {
  struct Chain {
    std::string name;           ///< of its boundary facets; not used between two regions
    std::vector<Index> points;  ///< the first again at the end closes it
    Index left, right;          ///< regions beside it, -1: void
  };
  std::vector<Vec<2>> points;
  std::vector<Chain> chains;
};

/// As triangulate, with a region to every cell. A vertex where parts of the body touch without sharing an edge is
/// split, so that they are not connected there. region_names are left to the caller. Throws InputError if chains cross,
/// if the domain is open or empty, and for options that triangulate refuses.
MeshData<2> triangulate_regions(const PlanarRegions& plane, const TriangulateOptions& options);

}  // namespace efree::internal
