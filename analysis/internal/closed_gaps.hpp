// SPDX-License-Identifier: GPL-3.0-or-later
/// Gaps of an image that its grid of cells does not keep open.
#pragma once

#include "efree/geometry/input/narrow_gaps.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <string>

namespace efree::internal {

/// A warning of gaps that a grid of so many cells over the image closes; empty: there are none.
inline std::string closed_gaps(const LabelImage<3>& image, const std::array<Index, 3>& cells) {
  const NarrowGaps gaps = narrow_gaps(image, cells);
  if (!(gaps.area > 0.0)) return "";
  return fmt::format(
      "gaps narrower than two cells are closed by the grid, of an area of {:.3g}, such as one {:.3g} wide at ({:.4g}): "
      "take mesh_size = {:.3g} or less",
      gaps.area, gaps.width, fmt::join(gaps.at, ", "), std::min(0.5 * gaps.width, image.spacing.minCoeff()));
}

}  // namespace efree::internal
