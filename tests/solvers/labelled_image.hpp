// SPDX-License-Identifier: GPL-3.0-or-later
/// Images by a formula, and a block of one that is stretched.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/geometry/input/label_image.hpp"

#include <array>
#include <functional>
#include <vector>

namespace efree::test {

/// An image whose voxels, of length 1, have the label of their middle.
inline LabelImage<3> image_of(const std::array<Index, 3>& size, const std::function<Label(const Vec<3>&)>& label) {
  LabelImage<3> image;
  image.size = size;
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i) image.labels.push_back(label(Vec<3>(i + 0.5, j + 0.5, k + 0.5)));
  return image;
}

/// Planes that slide on three sides, and the top moved along z.
inline std::vector<DisplacementCondition<3>> stretched_along_z(double by) {
  return {symmetry_plane<3>("left"),
          symmetry_plane<3>("front"),
          symmetry_plane<3>("bottom"),
          {"top", {}, [=](const Vec<3>&) { return by; }}};
}

}  // namespace efree::test
