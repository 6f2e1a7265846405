// SPDX-License-Identifier: GPL-3.0-or-later
/// Triangles of any surface, clean or dirty, turned so that the body lies behind them.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// Corners; the normal (b - a) x (c - a) points out of the body.
using Triangle = std::array<Vec<3>, 3>;

/// The triangles of a surface without those that are there twice or have no area.
struct OrientedTriangles {
  std::vector<Triangle> triangles;
  Index turned = 0;         ///< triangles that faced the other way in the file (up to a turn of the whole surface)
  Index shells_turned = 0;  ///< closed shells among them that were turned as a whole
};

/// Turns triangles to face as most of those do that they hang together with across edges of two triangles; where less
/// than three quarters of the area agree, outward. Closed shells then face by how they are nested, whatever the file
/// says: outward if an even number of other closed shells holds all of them, inward (a cavity) if an odd one does.
/// Open ones face as in the file, which is turned as a whole if it encloses a negative volume.
OrientedTriangles orient_triangles(const SurfaceSoup& soup);

}  // namespace efree::internal
