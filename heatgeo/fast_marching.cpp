// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/fast_marching.hpp"

#include "efree/core/internal/infinity.hpp"

#include <algorithm>

namespace efree {

using internal::infinity;

FastMarching::FastMarching(const SightLines& sight)
    : sight_(sight), distance_(sight.mesh().num_vertices(), infinity), origin_(sight.mesh().num_vertices(), -1) {}

void FastMarching::march(std::span<const Index> sources, double radius) {
  for (Index v : reached_) distance_[v] = infinity;
  reached_.clear();
  radius_ = radius;
  for (Index s : sources) offer(s, 0.0, s);
  while (!front_.empty()) {
    std::pop_heap(front_.begin(), front_.end());
    const Front nearest = front_.back();
    front_.pop_back();
    if (nearest.distance > distance_[nearest.vertex]) continue;
    spread_bent(nearest.vertex);
    spread_straight(nearest.vertex);
  }
}

void FastMarching::offer(Index v, double distance, Index origin) {
  // Differences of rounding size would only send the same front around again.
  if (distance >= radius_ || distance >= distance_[v] - sight_.tolerance()) return;
  if (distance_[v] == infinity) reached_.push_back(v);
  distance_[v] = distance;
  origin_[v] = origin;
  front_.push_back({distance, v});
  std::push_heap(front_.begin(), front_.end());
}

/// Paths that start at a, or bend there.
void FastMarching::spread_bent(Index a) {
  const FineMesh<2>& mesh = sight_.mesh();
  const Vec<2> x = mesh.vertex(a);
  const auto spread = [&](const auto& may_go) {
    for (Index c : mesh.cells_of(a))
      for (Index v : mesh.cells().col(c)) {
        const Vec<2> onward = mesh.vertex(v) - x;
        if (v != a && may_go(onward)) offer(v, distance_[a] + onward.norm(), a);
      }
  };
  if (origin_[a] == a) return spread([](const Vec<2>&) { return true; });
  for (const Corner& corner : sight_.corners(a))
    if (const auto wedge = sight_.bend(a, corner, mesh.vertex(origin_[a]), mesh.size()))
      spread([&](const Vec<2>& onward) { return wedge->contains(onward); });
}

/// Straight lines through the edges at a.
void FastMarching::spread_straight(Index a) {
  const FineMesh<2>& mesh = sight_.mesh();
  for (Index cell : mesh.cells_of(a)) {
    const auto corners = mesh.cells().col(cell);
    const Index i = corners[0] == a ? 0 : corners[1] == a ? 1 : 2;
    const Index b = corners[(i + 1) % 3], c = corners[(i + 2) % 3];
    if (distance_[b] < infinity) cross_edge(a, b, c);
    if (distance_[c] < infinity) cross_edge(a, c, b);
  }
}

void FastMarching::cross_edge(Index a, Index b, Index c) {
  const FineMesh<2>& mesh = sight_.mesh();
  const Vec<2> xa = mesh.vertex(a), xb = mesh.vertex(b), xc = mesh.vertex(c);
  const bool same_origin = origin_[a] == origin_[b];
  const auto offer_straight = [&](Index origin) {
    if (origin == a || origin == b) return;
    const Vec<2> start = mesh.vertex(origin), line = xc - start;
    const double length = line.norm(), distance = distance_[origin] + length;
    if (distance >= distance_[c] - sight_.tolerance()) return;
    const double slack = sight_.tolerance() * length, side_a = cross(line, xa - start),
                 side_b = cross(line, xb - start);
    if ((side_a > slack && side_b > slack) || (side_a < -slack && side_b < -slack)) return;
    if (cross(xb - xa, start - xa) * cross(xb - xa, xc - xa) > 0.0) return;
    // Where two fronts meet, the edge may be in the shadow of one of them.
    if (same_origin || sight_.visible(origin, c)) offer(c, distance, origin);
  };
  offer_straight(origin_[a]);
  if (!same_origin) offer_straight(origin_[b]);
  if (distance_[c] == infinity) {
    offer(c, distance_[a] + (xc - xa).norm(), a);
    offer(c, distance_[b] + (xc - xb).norm(), b);
  }
}

}  // namespace efree
