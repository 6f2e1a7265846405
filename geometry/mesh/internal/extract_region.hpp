// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <algorithm>
#include <optional>
#include <vector>

namespace efree::internal {

/// A region as a mesh of its own, with its vertices in their order; nothing if it has no cells.
template <int Dim> std::optional<FineMesh<Dim>> extract_region(const FineMesh<Dim>& mesh, Index region) {
  if (mesh.num_regions() == 1) return mesh;
  std::vector<char> kept(mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) kept[c] = mesh.region(c) == region ? 1 : 0;
  if (std::ranges::count(kept, 1) == 0) return {};
  return FineMesh<Dim>(extract(mesh, kept));
}

}  // namespace efree::internal
