// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes without islands.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree {

/// A mesh without its islands.
template <int Dim> struct LargestMesh {
  MeshData<Dim> mesh;     ///< with all vertices, also those that no cell uses any more
  Index islands = 0;      ///< bodies left out
  double fraction = 0.0;  ///< their part of the volume
};
/// Keeps the body of largest volume of all that hang together by vertices; of equal ones the first. Groups keep what is
/// left of them; all regions stay known. Cost linear in the mesh. Throws InputError for a mesh without a cell or a
/// vertex out of range.
template <int Dim> LargestMesh<Dim> keep_largest(MeshData<Dim> mesh);

}  // namespace efree
