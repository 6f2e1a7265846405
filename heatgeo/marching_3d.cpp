// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/marching_3d.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace efree {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

SpatialMarching::SpatialMarching(const SpatialSight& sight)
    : sight_(sight),
      states_(sight.mesh().num_vertices(), unreached),
      panorama_(sight),
      in_front_(sight.mesh().num_vertices(), 0) {}

void SpatialMarching::clear(double radius) {
  for (const Index v : reached_) states_[v] = unreached;
  for (const Index v : hidden_) states_[v] = unreached;
  reached_.clear();
  hidden_.clear();
  radius_ = radius;
}

void SpatialMarching::march(Index source, double radius) {
  clear(radius);
  source_ = source;
  const FineMesh<3>& mesh = sight_.mesh();
  const Vec<3> centre = mesh.vertex(source);
  const Index body = mesh.component()[source];
  panorama_.look(source_, radius);
  sight_.vertex_tree().for_each_near(centre, radius, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      const Index v = sight_.vertex_tree().order()[k];
      const Vec<3> line = mesh.vertex(v) - centre;
      const double distance = line.norm();
      if (distance >= radius || mesh.component()[v] != body) continue;
      if (v == source_ || panorama_.shows(v, line, distance))
        reach(v, distance, source_);
      else
        hidden_.push_back(v);
    }
  });
  // The march begins where what is in sight ends.
  for (const Index v : hidden_)
    for (const auto& [w, cell] : sight_.neighbours(v))
      if (states_[w].origin == source_ && !in_front_[w]) {
        in_front_[w] = 1;
        front_.push_back({states_[w].distance, w});
      }
  for (const Front& start : front_) in_front_[start.vertex] = 0;
  std::make_heap(front_.begin(), front_.end());
  spread();
}

void SpatialMarching::march(std::span<const Index> sources, double radius) {
  clear(radius);
  source_ = -1;
  for (const Index s : sources) offer(s, 0.0, s);
  spread();
  for (State& state : states_) state.unseen = -1;
}

void SpatialMarching::spread() {
  const FineMesh<3>& mesh = sight_.mesh();
  while (!front_.empty()) {
    std::pop_heap(front_.begin(), front_.end());
    const auto [distance, a] = front_.back();
    front_.pop_back();
    if (distance > states_[a].distance) continue;
    const Index origin = states_[a].origin;
    const double before = states_[origin].distance;
    const Vec<3> from = mesh.vertex(origin);
    const bool may_bend = origin == a || mesh.on_boundary(a);
    for (const auto& [v, cell] : sight_.neighbours(a)) {
      if (source_ >= 0 && states_[v].origin == source_) continue;
      // Bends are longer than straight lines.
      const double limit = std::min(states_[v].distance - sight_.tolerance(), radius_) - before;
      const double straight2 = (mesh.vertex(v) - from).squaredNorm();
      if (!(limit > 0.0) || straight2 >= limit * limit) continue;
      if (origin == a || sees({v, cell}, origin)) {
        offer(v, before + std::sqrt(straight2), origin);
      } else if (may_bend || states_[v].distance == infinity) {
        // Paths bend at the boundary; inside only where nothing better has come yet.
        offer(v, distance + (mesh.vertex(v) - mesh.vertex(a)).norm(), a);
      }
    }
  }
}

bool SpatialMarching::sees(const SpatialSight::Neighbour& near, Index origin) {
  if (origin == source_ || states_[near.vertex].unseen == origin) return false;
  const bool seen = sight_.sees(near, origin, [&](Index w) { return states_[w].origin == origin; });
  if (!seen) states_[near.vertex].unseen = origin;
  return seen;
}

void SpatialMarching::reach(Index v, double distance, Index origin) {
  if (states_[v].distance == infinity) reached_.push_back(v);
  states_[v].distance = distance;
  states_[v].origin = origin;
}

void SpatialMarching::offer(Index v, double distance, Index origin) {
  // Differences of rounding size would only send the same front around again.
  if (distance >= radius_ || distance >= states_[v].distance - sight_.tolerance()) return;
  reach(v, distance, origin);
  front_.push_back({distance, v});
  std::push_heap(front_.begin(), front_.end());
}

}  // namespace efree
