// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/triangle_tree.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

namespace efree::internal {
namespace {

constexpr Index triangles_of_leaf = 4;  ///< triangles that are not parted further

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

/// Barycentric coordinates of the point of a triangle nearest to x (Ericson 2005, section 5.1.5).
Vec<3> nearest_in(const Triangle& triangle, const Vec<3>& x) {
  const auto& [a, b, c] = triangle;
  const Vec<3> ab = b - a, ac = c - a, ax = x - a, bx = x - b, cx = x - c;
  const double d1 = ab.dot(ax), d2 = ac.dot(ax), d3 = ab.dot(bx), d4 = ac.dot(bx), d5 = ab.dot(cx), d6 = ac.dot(cx);
  if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
  if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
  if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
  const double of_c = d1 * d4 - d3 * d2, of_b = d5 * d2 - d1 * d6, of_a = d3 * d6 - d5 * d4;
  if (of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0};
  if (of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)};
  if (of_a <= 0.0 && d4 >= d3 && d5 >= d6) {
    const double at_c = (d4 - d3) / (d4 - d3 + d5 - d6);
    return {0.0, 1.0 - at_c, at_c};
  }
  const double sum = of_a + of_b + of_c;
  return {of_a / sum, of_b / sum, of_c / sum};
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
  if (end - begin > triangles_of_leaf) {
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

std::optional<TriangleTree::Nearest> TriangleTree::nearest(const Vec<3>& x, const Vec<3>& facing,
                                                           double farthest) const {
  std::optional<Nearest> found;
  const auto bound = [&] { return found ? found->distance2 : farthest * farthest; };
  for (Index n = 0; n < std::ssize(nodes_);) {
    const Node& node = nodes_[n];
    if (node.box.squaredExteriorDistance(x) > bound()) {
      n = node.after;
      continue;
    }
    if (node.after == n + 1)
      for (Index k = node.begin; k < node.end; ++k) {
        const Index t = order_[k];
        const auto& [a, b, c] = triangles_[t];
        const Vec<3> area = (b - a).cross(c - a);
        if (area.dot(facing) <= 0.5 * area.norm()) continue;
        const Vec<3> weights = nearest_in(triangles_[t], x);
        const double distance2 = (weights[0] * a + weights[1] * b + weights[2] * c - x).squaredNorm();
        if (distance2 > bound() || (found && distance2 == found->distance2 && t > found->triangle)) continue;
        found = Nearest{t, weights, distance2};
      }
    ++n;
  }
  return found;
}

}  // namespace efree::internal
