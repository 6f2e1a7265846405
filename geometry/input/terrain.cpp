// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/terrain.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <vector>

namespace efree {

SurfaceSoup terrain(const GreyImage<2>& heights) {
  const auto [nx, ny] = heights.size;
  if (nx < 2 || ny < 2) throw InputError(fmt::format("a terrain: {} x {} pixels, expected at least 2 x 2", nx, ny));
  require(heights.values.size() == static_cast<std::size_t>(nx * ny) &&
              std::ranges::all_of(heights.values, [](float height) { return std::isfinite(height); }),
          "a terrain: expected a height for every pixel that is a number");
  // The surface, the same corners along its rim at the bottom, and the middle of the bottom.
  const Index top = nx * ny, rim = 2 * (nx + ny) - 4;
  SurfaceSoup ground;
  Points<3>& vertices = ground.points;
  vertices.resize(3, top + rim + 1);
  for (Index j = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) {
      const Vec<2> at = heights.origin + heights.spacing.cwiseProduct(
                                             Vec<2>(static_cast<double>(i) + 0.5, static_cast<double>(j) + 0.5));
      vertices.col(i + nx * j) << at, heights.values[static_cast<std::size_t>(i + nx * j)];
    }
  const auto surface = vertices.leftCols(top);
  const Vec<3> lowest = surface.rowwise().minCoeff(), highest = surface.rowwise().maxCoeff();
  const double bottom = lowest[2] - (highest - lowest).head<2>().maxCoeff();
  std::vector<Index> around;  // counterclockwise
  for (Index i = 0; i < nx - 1; ++i) around.push_back(i);
  for (Index j = 0; j < ny - 1; ++j) around.push_back(nx - 1 + nx * j);
  for (Index i = nx - 1; i > 0; --i) around.push_back(i + nx * (ny - 1));
  for (Index j = ny - 1; j > 0; --j) around.push_back(nx * j);
  for (Index k = 0; k < rim; ++k) vertices.col(top + k) << vertices.col(around[k]).head<2>(), bottom;
  vertices.col(top + rim) << 0.5 * (lowest + highest).head<2>(), bottom;
  auto& triangles = ground.triangles;
  for (Index j = 0; j < ny - 1; ++j)
    for (Index i = 0; i < nx - 1; ++i) {
      const Index a = i + nx * j, b = a + 1, c = b + nx, d = a + nx;
      triangles.push_back({a, b, c});
      triangles.push_back({a, c, d});
    }
  for (Index k = 0; k < rim; ++k) {
    const Index next = (k + 1) % rim, a = top + k, b = top + next, c = around[next], d = around[k];
    triangles.push_back({a, b, c});
    triangles.push_back({a, c, d});
    triangles.push_back({b, a, top + rim});
  }
  return ground;
}

}  // namespace efree
