// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/internal/winding.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace efree::internal {
namespace {

/// Triangles from farther away than this many radii count as one dipole: winding numbers are right to 0.01.
constexpr double far_away = 3.0;
constexpr Index triangles_of_cluster = 8;  ///< triangles that are not parted further

/// Solid angle of a triangle seen from q, positive from behind (Van Oosterom & Strackee 1983).
double solid_angle(const Triangle& triangle, const Vec<3>& q) {
  const Vec<3> a = triangle[0] - q, b = triangle[1] - q, c = triangle[2] - q;
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

}  // namespace

Winding::Winding(std::vector<Triangle> triangles) : triangles_(std::move(triangles)) {
  build(0, static_cast<Index>(triangles_.size()));
}

double Winding::operator()(const Vec<3>& q) const {
  double sum = 0.0;
  for (Index n = 0; n < std::ssize(clusters_);) {
    const Cluster& cluster = clusters_[n];
    const Vec<3> away = cluster.centre - q;
    const double distance = away.norm();
    if (distance > far_away * cluster.radius) {
      sum += cluster.dipole.dot(away) / (distance * distance * distance);
      n = cluster.after;
    } else if (cluster.after == n + 1) {
      for (Index t = cluster.begin; t < cluster.end; ++t) sum += solid_angle(triangles_[t], q);
      n = cluster.after;
    } else {
      ++n;
    }
  }
  return sum / (4.0 * std::numbers::pi);
}

void Winding::build(Index begin, Index end) {
  const auto at = clusters_.size();
  Cluster cluster{Vec<3>::Zero(), Vec<3>::Zero(), 0.0, begin, end, 0};
  Vec<3> low = triangles_[begin][0], high = low;
  double total = 0.0;
  for (Index t = begin; t < end; ++t) {
    const auto& [a, b, c] = triangles_[t];
    const Vec<3> area = 0.5 * (b - a).cross(c - a), middle = (a + b + c) / 3.0;
    cluster.dipole += area;
    cluster.centre += area.norm() * middle;
    total += area.norm();
    low = low.cwiseMin(middle);
    high = high.cwiseMax(middle);
  }
  cluster.centre /= total;
  for (Index t = begin; t < end; ++t)
    for (const Vec<3>& corner : triangles_[t])
      cluster.radius = std::max(cluster.radius, (corner - cluster.centre).norm());
  clusters_.push_back(cluster);
  if (end - begin > triangles_of_cluster) {
    int axis = 0;
    (high - low).maxCoeff(&axis);
    const Index half = begin + (end - begin) / 2;
    const auto middle = [&](const Triangle& t) { return t[0][axis] + t[1][axis] + t[2][axis]; };
    std::ranges::stable_sort(triangles_.begin() + begin, triangles_.begin() + end, {}, middle);
    build(begin, half);
    build(half, end);
  }
  clusters_[at].after = static_cast<Index>(clusters_.size());
}

}  // namespace efree::internal
