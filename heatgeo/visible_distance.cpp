// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/visible_distance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr int sectors = 256;
constexpr double sector_slack = 1e-6;  // far more than the rounding of a direction, far less than a sector

/// Grows with the angle of v from 0 to `sectors`, without trigonometry.
double sector_coordinate(const Vec<2>& v) {
  const double p = v.x() / (std::abs(v.x()) + std::abs(v.y()));
  return 0.25 * sectors * (v.y() < 0.0 ? 3.0 + p : 1.0 - p);
}

/// Smallest and largest x of the directions in the wedge that are no longer than `reach`.
std::pair<double, double> horizontal_extent(const BendingWedge& wedge, double reach) {
  const double cosine_of_half = 0.5 * (wedge.first + wedge.last).norm();
  if (cosine_of_half < 0.5) return {-reach, reach};
  // A triangle around the sector.
  const double a = reach * wedge.first.x() / cosine_of_half, b = reach * wedge.last.x() / cosine_of_half;
  return {std::min({0.0, a, b}), std::max({0.0, a, b})};
}

double distance_to_segment(const Vec<2>& a, const Vec<2>& b) {
  const Vec<2> along = b - a;
  const double t = std::clamp(-a.dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (a + t * along).norm();
}

}  // namespace

VisibleDistance::VisibleDistance(const SightLines& sight) : sight_(sight) {}

const std::vector<double>& VisibleDistance::from(const Patch<2>& patch) {
  distances_ = patch.distances;
  if (!patch.obstructed) return distances_;
  radius_ = patch.radius;
  bends_.clear();
  build_horizon(patch);
  find_hidden(patch);
  while (!bends_.empty() && !hidden_.empty()) {
    std::pop_heap(bends_.begin(), bends_.end());
    const Bend bend = bends_.back();
    bends_.pop_back();
    bend_at(bend.vertex, bend.distance, bend.came_from);
  }
  return distances_;
}

/// In every direction, the distance within which no facet shows its outer side.
void VisibleDistance::build_horizon(const Patch<2>& patch) {
  const FineMesh<2>& mesh = sight_.mesh();
  const Vec<2> source = mesh.vertex(patch.source);
  horizon_.assign(sectors, infinity);
  const auto lower = [&](const Vec<2>& right, const Vec<2>& left, double distance) {
    const int first = static_cast<int>(std::floor(sector_coordinate(right) - sector_slack));
    int last = static_cast<int>(std::floor(sector_coordinate(left) + sector_slack));
    if (last < first) last += sectors;
    for (int k = first; k <= last; ++k) {
      double& horizon = horizon_[(k + sectors) % sectors];
      horizon = std::min(horizon, distance);
    }
  };
  for (Index f : patch.facets) {
    if (!shows_outer_side(mesh, f, source, sight_.tolerance())) continue;
    // Seen from its outer side a facet runs clockwise.
    const Vec<2> left = mesh.vertex(mesh.facets()(0, f)) - source, right = mesh.vertex(mesh.facets()(1, f)) - source;
    lower(right, left, distance_to_segment(right, left) * (1.0 - sector_slack));
  }
  for (const Corner& corner : sight_.corners(patch.source))
    lower(mesh.vertex(corner.previous) - source, mesh.vertex(corner.next) - source, 0.0);
}

/// Lists the vertices that the source does not see and queues the bends that it does see.
void VisibleDistance::find_hidden(const Patch<2>& patch) {
  const FineMesh<2>& mesh = sight_.mesh();
  const Vec<2> source = mesh.vertex(patch.source);
  hidden_.clear();
  for (std::size_t k = 1; k < patch.vertices.size(); ++k) {
    if (distances_[k] >= radius_) continue;
    const Index v = patch.vertices[k];
    const Vec<2> x = mesh.vertex(v);
    const auto surely_seen = [&] {
      return distances_[k] > 0.0 && distances_[k] < horizon_[static_cast<int>(sector_coordinate(x - source)) % sectors];
    };
    if (surely_seen() || sight_.visible(patch.source, v)) {
      if (sight_.is_reflex(v)) bends_.push_back({distances_[k], v, source});
    } else {
      distances_[k] = infinity;
      hidden_.push_back({x, v, static_cast<Index>(k)});
    }
  }
  std::sort(hidden_.begin(), hidden_.end(), [](const Hidden& a, const Hidden& b) {
    return a.position.x() != b.position.x() ? a.position.x() < b.position.x() : a.row < b.row;
  });
  std::make_heap(bends_.begin(), bends_.end());
}

void VisibleDistance::bend_at(Index corner_vertex, double distance, const Vec<2>& came_from) {
  const Vec<2> x = sight_.mesh().vertex(corner_vertex);
  const double reach = radius_ - distance;
  for (const Corner& corner : sight_.corners(corner_vertex)) {
    const auto wedge = sight_.bend(corner_vertex, corner, came_from, reach);
    if (!wedge) continue;
    const auto [low, high] = horizontal_extent(*wedge, reach);
    auto hidden = std::lower_bound(hidden_.begin(), hidden_.end(), x.x() + low - wedge->slack,
                                   [](const Hidden& h, double value) { return h.position.x() < value; });
    for (; hidden != hidden_.end() && hidden->position.x() <= x.x() + high + wedge->slack; ++hidden) {
      const Vec<2> onward = hidden->position - x;
      if (!wedge->contains(onward)) continue;
      const double length = distance + onward.norm();
      if (length >= std::min(radius_, distances_[hidden->row]) || !sight_.visible(corner_vertex, hidden->vertex))
        continue;
      distances_[hidden->row] = length;
      if (!sight_.is_reflex(hidden->vertex)) continue;
      bends_.push_back({length, hidden->vertex, x});
      std::push_heap(bends_.begin(), bends_.end());
    }
  }
}

}  // namespace efree
