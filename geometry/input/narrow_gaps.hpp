// SPDX-License-Identifier: GPL-3.0-or-later
/// Gaps between walls of an image that a grid of cells does not see.
#pragma once

#include "efree/geometry/input/label_image.hpp"

namespace efree {

/// Void between two walls, along an axis of the image, that holds no whole cell of a grid, so that functions on cells
/// join the walls.
struct NarrowGaps {
  double area = 0.0;           ///< across their axes [length^2]
  Vec<3> at = Vec<3>::Zero();  ///< the middle of one of them, in the world
  double width = 0.0;          ///< of that one [length]
};

/// Those that go on to all sides for more than three halves of a cell, as slits and faces of neighbouring bodies do,
/// and rims of pores do not. The image's frame is cut into so many equal cells along each axis. Bitwise the same on any
/// number of threads.
NarrowGaps narrow_gaps(const LabelImage<3>& image, const std::array<Index, 3>& cells);

}  // namespace efree
