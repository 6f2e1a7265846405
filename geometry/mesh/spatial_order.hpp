// SPDX-License-Identifier: GPL-3.0-or-later
/// Numbering meshes for speed.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree {

/// The same mesh with its vertices along a space-filling curve (Hilbert 1891) and its cells by their first vertices:
/// neighbours in space are neighbours in memory. On what mesh generators number as they go, sums over nodes take twice
/// as long.
template <int Dim> MeshData<Dim> in_spatial_order(MeshData<Dim> mesh);

}  // namespace efree
