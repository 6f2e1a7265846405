// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes made finer.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"

namespace efree {

/// Bisects edges, the longest first, until none is longer than `longest`. Every cell around an edge is cut in two, so
/// the mesh stays conforming; groups and regions follow, old vertices keep their numbers. Cells get no flatter without
/// bound (longest-edge bisection; Rivara 1984). Deterministic, O(n log n) for each pass over the mesh; few passes if
/// few edges are too long. Throws InputError if `longest` is not positive or a cell's vertex is out of range.
template <int Dim> MeshData<Dim> split_long_edges(MeshData<Dim> mesh, double longest);
/// The same, with the offsets of the facets' halves, which stay where the facet was: those of points on quadratic
/// facets. Facets that belong to no group have offsets along split edges only.
template <int Dim> CurvedMesh<Dim> split_long_edges(CurvedMesh<Dim> curved, double longest);

}  // namespace efree
