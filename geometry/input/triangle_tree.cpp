// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/triangle_tree.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace efree::internal {
namespace {

constexpr Index few = 4;  ///< triangles that are not parted further

/// Distance along a ray to a triangle (Moeller & Trumbore 1997), rays along its edges included; infinity for none.
double distance_to(const Triangle& triangle, const Vec<3>& from, const Vec<3>& direction) {
  constexpr double none = std::numeric_limits<double>::infinity(), rounding = 1e-12;
  const Vec<3> e1 = triangle[1] - triangle[0], e2 = triangle[2] - triangle[0], across = direction.cross(e2);
  const double volume = e1.dot(across);
  if (volume == 0.0) return none;
  const Vec<3> away = from - triangle[0], normal = away.cross(e1);
  const double u = away.dot(across) / volume, v = direction.dot(normal) / volume;
  if (!(u >= -rounding && v >= -rounding && u + v <= 1.0 + rounding)) return none;
  return e2.dot(normal) / volume;
}

/// Whether a ray meets a box on [nearest, farthest].
bool meets(const Eigen::AlignedBox3d& box, const Vec<3>& from, const Vec<3>& direction, double nearest,
           double farthest) {
  for (int d = 0; d < 3; ++d) {
    if (direction[d] == 0.0) {
      if (from[d] < box.min()[d] || from[d] > box.max()[d]) return false;
      continue;
    }
    const double a = (box.min()[d] - from[d]) / direction[d], b = (box.max()[d] - from[d]) / direction[d];
    nearest = std::max(nearest, std::min(a, b));
    farthest = std::min(farthest, std::max(a, b));
  }
  return nearest <= farthest;
}

}  // namespace

TriangleTree::TriangleTree(std::vector<Triangle> triangles)
    : triangles_(std::move(triangles)), order_(triangles_.size()) {
  std::iota(order_.begin(), order_.end(), Index(0));
  if (!triangles_.empty()) build(0, static_cast<Index>(triangles_.size()));
}

void TriangleTree::build(Index begin, Index end) {
  const auto at = nodes_.size();
  Node node{{}, begin, end, 0};
  Eigen::AlignedBox3d middles;
  for (Index k = begin; k < end; ++k) {
    const auto& [a, b, c] = triangles_[order_[k]];
    node.box.extend(a).extend(b).extend(c);
    middles.extend((a + b + c) / 3.0);
  }
  // Flat boxes are met by rays that rounding takes past them.
  const double margin = 1e-12 * (node.box.min().cwiseAbs().maxCoeff() + node.box.max().cwiseAbs().maxCoeff());
  node.box.min().array() -= margin;
  node.box.max().array() += margin;
  nodes_.push_back(node);
  if (end - begin > few) {
    int axis = 0;
    middles.sizes().maxCoeff(&axis);
    const Index half = begin + (end - begin) / 2;
    const auto place = [&](Index t) {  // no two alike, so that the halves are the same everywhere
      return std::pair(triangles_[t][0][axis] + triangles_[t][1][axis] + triangles_[t][2][axis], t);
    };
    std::ranges::nth_element(order_.begin() + begin, order_.begin() + half, order_.begin() + end, {}, place);
    build(begin, half);
    build(half, end);
  }
  nodes_[at].after = static_cast<Index>(nodes_.size());
}

std::optional<TriangleTree::Hit> TriangleTree::first_hit(const Vec<3>& from, const Vec<3>& direction, double nearest,
                                                         double farthest, Index except) const {
  std::optional<Hit> first;
  for (Index n = 0; n < std::ssize(nodes_);) {
    const Node& node = nodes_[n];
    if (!meets(node.box, from, direction, nearest, first ? first->distance : farthest)) {
      n = node.after;
      continue;
    }
    if (node.after == n + 1)
      for (Index k = node.begin; k < node.end; ++k) {
        const Index t = order_[k];
        if (t == except) continue;
        const double distance = distance_to(triangles_[t], from, direction);
        if (distance < nearest || !(distance <= farthest)) continue;
        if (!first || distance < first->distance || (distance == first->distance && t < first->triangle))
          first = Hit{distance, t};
      }
    ++n;
  }
  return first;
}

}  // namespace efree::internal
