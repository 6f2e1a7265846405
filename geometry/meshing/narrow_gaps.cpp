// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/narrow_gaps.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/input/internal/find_gaps.hpp"
#include "efree/geometry/input/internal/triangle_tree.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace efree::internal {

namespace {

std::vector<Triangle> triangles_of(const SurfaceSoup& surface) {
  std::vector<Triangle> triangles;
  for (const auto& [a, b, c] : surface.triangles)
    triangles.push_back({surface.points.col(a), surface.points.col(b), surface.points.col(c)});
  return triangles;
}

/// A side of a triangle: from its corner of that number to the next.
struct Side {
  std::array<Index, 2> edge;  ///< points, ascending
  Index triangle;
  int corner;
};

/// Sides of triangles along edges at which the surface turns, as it does at any rim, by their edges.
std::vector<Side> sides_of_ridges(const SurfaceSoup& surface, const std::vector<Triangle>& triangles) {
  constexpr double cosine = 0.97;  // of 14 degrees
  std::vector<Side> sides, ridges;
  for (Index t = 0; t < std::ssize(triangles); ++t)
    for (int k = 0; k < 3; ++k) {
      const auto [low, high] = std::minmax(surface.triangles[t][k], surface.triangles[t][(k + 1) % 3]);
      sides.push_back({{low, high}, t, k});
    }
  std::ranges::sort(sides, {}, [](const Side& side) { return std::pair(side.edge, side.triangle); });
  for (std::size_t k = 0; k + 1 < sides.size(); ++k)
    if (sides[k].edge == sides[k + 1].edge &&
        normal_of(triangles[sides[k].triangle]).dot(normal_of(triangles[sides[k + 1].triangle])) < cosine) {
      ridges.push_back(sides[k]);
      ridges.push_back(sides[k + 1]);
    }
  return ridges;
}

}  // namespace

std::set<std::array<Index, 2>> rims_of_gaps(const SurfaceSoup& surface, double width, double size) {
  constexpr double inwards = 1e-3, most_points = 1e4;
  const std::vector<Triangle> triangles = triangles_of(surface);
  const std::vector<Side> sides = sides_of_ridges(surface, triangles);
  if (sides.empty()) return {};
  const TriangleTree tree(triangles);
  std::set<std::array<Index, 2>> rims;
  std::vector<char> at_rim(surface.points.cols(), 0);
  for (const Side& side : sides) {
    const Triangle& t = triangles[side.triangle];
    const Vec<3>&a = t[side.corner], &b = t[(side.corner + 1) % 3], &opposite = t[(side.corner + 2) % 3];
    const Vec<3> outward = normal_of(t);
    const int count = static_cast<int>(std::clamp(std::ceil(2.0 * (b - a).norm() / size), 1.0, most_points));
    for (int n = 0; n < count; ++n) {
      const Vec<3> on_edge = a + (n + 0.5) / count * (b - a), from = on_edge + inwards * (opposite - on_edge);
      const auto hit = tree.first_hit(from, outward, 1e-9 * width, width, side.triangle);
      if (!hit || outward.dot(normal_of(triangles[hit->triangle])) > facing_walls) continue;
      rims.insert(side.edge);
      at_rim[side.edge[0]] = at_rim[side.edge[1]] = 1;
      break;
    }
  }
  for (const Side& side : sides)
    if (at_rim[side.edge[0]] && at_rim[side.edge[1]] &&
        (surface.points.col(side.edge[0]) - surface.points.col(side.edge[1])).norm() < width)
      rims.insert(side.edge);
  return rims;
}

void refuse_costly_gaps(const SurfaceSoup& body, double enclosed, const SurfaceMeshOptions& options) {
  // Measured on a slit through most of a body: 43 tetrahedra to a cube of the size, 1.7 more to a square of the width
  // on the walls, and these take five times as long as others.
  constexpr double of_body = 43.0, of_gap = 1.7, slower = 5.0, most = 2.0, closed_share = 1.1;
  const double size = options.size, distance = options.distance > 0.0 ? options.distance : size / 20.0;
  double more = 0.0, most_of_one = 0.0;
  const SurfaceGap* worst = nullptr;
  const auto gaps = find_gaps(triangles_of(body), narrow_share * size, 0.5 * size);
  for (const SurfaceGap& gap : gaps) {
    double cells = 0.0;
    for (const auto& sample : gap.samples)
      if (const double width = sample.width(); width > closed_share * distance)
        cells += of_gap * sample.area / (width * width);
    if (cells > most_of_one) {
      most_of_one = cells;
      worst = &gap;
    }
    more += cells;
  }
  const double times = 1.0 + slower * more / (of_body * enclosed / std::pow(size, 3));
  if (!worst || times <= most) return;
  throw InputError(fmt::format(
      "surface: a slit {:.3g} wide at ({:.6g}) is too narrow for a mesh size of {:g} to resolve it and too wide to "
      "close "
      "it, which would take about {:.2g} times as long as the body without it. Take a size of {:.2g} to keep it; a "
      "size "
      "of {:.2g}, a wrap or a lattice closes it and warns of that",
      worst->narrowest, fmt::join(worst->at, ", "), size, times, 3.0 * worst->narrowest, 25.0 * worst->widest));
}

}  // namespace efree::internal
