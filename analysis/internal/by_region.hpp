// SPDX-License-Identifier: GPL-3.0-or-later
/// What belongs to a region.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/basis/fine_space.hpp"

#include <algorithm>
#include <string>
#include <vector>

namespace efree::internal {

/// The material of a region; null where it has none of its own, but that of the whole body.
template <int Dim> const RegionMaterial* material_of(const CommonSettings<Dim>& settings, const std::string& region) {
  const auto found = std::ranges::find(settings.materials, region, &RegionMaterial::region);
  return found == settings.materials.end() ? nullptr : &*found;
}

/// Region of the mesh by place of the space.
template <int Dim> std::vector<Index> regions_of_places(const FineSpace<Dim>& space) {
  std::vector<Index> result(space.num_places(), 0);
  for (Index c = 0; c < space.mesh().num_cells(); ++c)
    for (const Index place : space.places(c)) result[place] = space.mesh().region(c);
  return result;
}

}  // namespace efree::internal
