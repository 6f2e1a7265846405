// SPDX-License-Identifier: GPL-3.0-or-later
/// What an image holds, told from its pixels alone.
#pragma once

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/summary.hpp"

#include <array>
#include <optional>
#include <vector>

namespace efree {

/// A connected part of an image: pixels that meet in edges (faces in 3D).
template <int Dim> struct ImagePart {
  std::int64_t pixels = 0;
  Vec<Dim> centre;  ///< of its pixels [length]
};

/// Faces of pixels on the boundary of the material, those of a run along one axis as one.
template <int Dim> struct ImageFacet {
  std::array<Vec<Dim>, 1 << (Dim - 1)> corners;  ///< in order around it
  Index label;                                   ///< by `labels` of the summary
  Index group;                                   ///< by `groups` of the summary
};

/// What an image holds, before it is meshed.
template <int Dim> struct ImageSummary {
  std::vector<BodySummary<Dim>> labels;   ///< all but 0, ascending, named by their numbers; cells are pixels
  std::vector<GroupSummary<Dim>> groups;  ///< as mesh_image names them, as far as there are any; facets are pixels'
  std::vector<ImageFacet<Dim>> facets;
  double material = 0.0;   ///< part of the image that is not void
  Index bodies = 0;        ///< connected parts of all that is not void
  Index closed_pores = 0;  ///< connected parts of the void that do not reach the image's frame
  std::optional<ImagePart<Dim>> smallest_body, smallest_pore;  ///< the latter of the closed ones
};

/// Throws InputError for a broken image and one that is all void. Linear in the pixels.
template <int Dim> ImageSummary<Dim> summarize_image(const LabelImage<Dim>& image);

}  // namespace efree
