// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/image_regions.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>

namespace efree::internal {

template <int Dim> ImageRegions image_regions(const LabelImage<Dim>& image, const ImageMeshOptions& options) {
  check_image(image);
  if (!(options.size > 0.0 && std::isfinite(options.size)))
    throw InputError(fmt::format("image: size is {}, expected a positive length", options.size));
  if (!(options.simplify >= 0.0 && std::isfinite(options.simplify)))
    throw InputError(fmt::format("image: simplify is {}, expected 0 or more pixels", options.simplify));
  if (!(options.facet_distance > 0.0 && std::isfinite(options.facet_distance)))
    throw InputError(fmt::format("image: facet_distance is {}, expected more than 0 voxels", options.facet_distance));
  std::vector<Label> found;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) found.push_back(count.label);
  if (found.empty()) throw InputError("image: all of it is void");
  const auto complain = [&](Label label, const char* text) {
    throw InputError(
        fmt::format("image: label {} {}; the image has the labels {}", label, text, fmt::join(found, ", ")));
  };
  for (const auto& [label, name] : options.names)
    if (!std::binary_search(found.begin(), found.end(), label)) complain(label, "has a region but no pixel");

  ImageRegions out;
  out.of_label.assign(found.back() + 1, -1);
  for (const Label label : found) {
    const auto named = options.names.find(label);
    if (named == options.names.end() && !options.names.empty()) complain(label, "has no region");
    const std::string name = named == options.names.end() ? std::to_string(label) : named->second;
    auto place = std::find(out.names.begin(), out.names.end(), name);
    if (place == out.names.end()) place = out.names.insert(place, name);
    out.of_label[label] = static_cast<Index>(place - out.names.begin());
  }
  return out;
}

template <int Dim> void turn_to_world(const LabelImage<Dim>& image, Points<Dim>& vertices) {
  if (!image.is_turned()) return;
  for (Index v = 0; v < vertices.cols(); ++v) vertices.col(v) = image.in_world(vertices.col(v));
}

template void turn_to_world<2>(const LabelImage<2>&, Points<2>&);
template void turn_to_world<3>(const LabelImage<3>&, Points<3>&);
template ImageRegions image_regions<2>(const LabelImage<2>&, const ImageMeshOptions&);
template ImageRegions image_regions<3>(const LabelImage<3>&, const ImageMeshOptions&);

}  // namespace efree::internal
