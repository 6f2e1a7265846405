// SPDX-License-Identifier: GPL-3.0-or-later
/// find_gaps of triangles that are known to face outward.
#pragma once

#include "efree/geometry/input/internal/oriented_triangles.hpp"
#include "efree/geometry/input/surface_gaps.hpp"

namespace efree::internal {

/// Cosine between the normals of two walls that face each other, at most.
constexpr double facing_walls = -0.7;

inline Vec<3> normal_of(const Triangle& t) {
  const Vec<3> e1 = t[1] - t[0], e2 = t[2] - t[0];
  return Vec<3>(e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2], e1[0] * e2[1] - e1[1] * e2[0])
      .normalized();
}

/// As efree::find_gaps.
std::vector<SurfaceGap> find_gaps(const std::vector<Triangle>& outward, double widest, double spacing);

}  // namespace efree::internal
