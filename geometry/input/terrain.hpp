// SPDX-License-Identifier: GPL-3.0-or-later
/// Terrain from pictures of its heights.
#pragma once

#include "efree/geometry/input/grey_image.hpp"
#include "efree/geometry/input/surface.hpp"

namespace efree {

/// The closed surface of the ground whose heights z are the image's values in the centres of its pixels, with two
/// triangles between four of them. It ends at the outermost centres, as deep below the lowest as it is long. Throws
/// InputError for fewer than two pixels along an axis, or heights that are no numbers.
SurfaceSoup terrain(const GreyImage<2>& heights);

}  // namespace efree
