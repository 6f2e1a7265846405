// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/ball_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {

BallSearch::BallSearch(const FineMesh<2>& mesh) : mesh_(mesh), origin_(mesh.vertices().rowwise().minCoeff()) {
  constexpr double vertices_per_square = 8.0;
  const Vec<2> extent = mesh.vertices().rowwise().maxCoeff() - origin_;
  width_ = std::sqrt(extent.prod() * vertices_per_square / mesh.num_vertices());
  columns_ = static_cast<Index>(extent.x() / width_) + 1;
  rows_ = static_cast<Index>(extent.y() / width_) + 1;

  std::vector<Index> of(mesh.num_vertices());
  squares_.offsets.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const auto at = square(mesh.vertex(v));
    of[v] = at.y() * columns_ + at.x();
    ++squares_.offsets[of[v] + 1];
  }
  std::partial_sum(squares_.offsets.begin(), squares_.offsets.end(), squares_.offsets.begin());
  squares_.items.resize(mesh.num_vertices());
  std::vector<Index> cursor(squares_.offsets.begin(), squares_.offsets.end() - 1);
  for (Index v = 0; v < mesh.num_vertices(); ++v) squares_.items[cursor[of[v]]++] = v;
}

Eigen::Vector2i BallSearch::square(const Vec<2>& x) const {
  const Vec<2> at = (x - origin_) / width_;
  return {static_cast<int>(std::clamp(at.x(), 0.0, columns_ - 1.0)),
          static_cast<int>(std::clamp(at.y(), 0.0, rows_ - 1.0))};
}

}  // namespace efree
