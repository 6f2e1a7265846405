// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes made finer.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree {

/// Bisects edges, the longest first, until none is longer than `longest`. Every cell around an edge is cut in two, so
/// the mesh stays conforming; groups and regions follow, old vertices keep their numbers. Cells get no flatter without
/// bound (longest-edge bisection; Rivara 1984). Deterministic, O(n log n) for each pass over the mesh; few passes if
/// few edges are too long. Throws InputError if `longest` is not positive or a cell's vertex is out of range.
template <int Dim> MeshData<Dim> split_long_edges(MeshData<Dim> mesh, double longest);

}  // namespace efree
