// SPDX-License-Identifier: GPL-3.0-or-later
/// What a mesh on a lattice loses of its image.
#pragma once

#include "efree/geometry/meshing/lattice_mesh.hpp"

namespace efree::internal {

/// Bodies of the mesh that hang together in the image, but not in the mesh.
void find_broken(const LabelImage<3>& image, LatticeMesh& out);

}  // namespace efree::internal
