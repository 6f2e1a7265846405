// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/image_parts.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <iterator>

namespace efree::internal {

VoxelParts image_parts(const Settings<3>& settings, const LabelImage<3>& image) {
  const ImageBoundary boundary(image);
  VoxelParts parts;
  const auto find = [&](const auto& itself, const std::string& name) -> const std::vector<VoxelFacet>& {
    const auto [part, is_new] = parts.try_emplace(name);
    std::vector<VoxelFacet>& facets = part->second;
    if (!is_new) return facets;
    const auto selected = std::ranges::find(settings.common.selections, name, &NamedSelection<3>::name);
    if (selected == settings.common.selections.end()) {
      facets = boundary.named(name);
      if (facets.empty()) throw InputError(fmt::format("the image has no material on \"{}\"", name));
      return facets;
    }
    if (selected->parts.empty()) facets = boundary.select(selected->how);
    for (const std::string& other : selected->parts) {
      std::vector<VoxelFacet> all;
      std::ranges::set_union(facets, itself(itself, other), std::back_inserter(all));
      facets = std::move(all);
    }
    if (facets.empty()) {
      const Vec<3> lengths = image.spacing.cwiseProduct(Vec<3>(image.size[0], image.size[1], image.size[2]));
      throw InputError(
          fmt::format("the selection \"{}\" is empty: no face of a voxel between material and void, or on "
                      "the image's frame from ({:.6g}) to ({:.6g}), belongs to it",
                      name, fmt::join(image.origin, ", "), fmt::join(image.in_world(image.origin + lengths), ", ")));
    }
    return facets;
  };
  for (const Mention& mention : boundaries(settings)) {
    const auto selected = std::ranges::find(settings.common.selections, mention.name, &NamedSelection<3>::name);
    const bool said = selected != settings.common.selections.end() && !selected->where.empty();
    located(settings.common, said ? selected->where : mention.where, [&] { find(find, mention.name); });
  }
  return parts;
}

}  // namespace efree::internal
