// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/marching_3d.hpp"

#include "efree/core/internal/infinity.hpp"

#include <algorithm>
#include <cmath>

namespace efree {

using internal::infinity;

SpatialMarching::SpatialMarching(const SpatialSight& sight)
    : sight_(sight), states_(sight.mesh().num_vertices(), unreached), panorama_(sight) {}

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
  sight_.for_each_vertex_near(centre, radius, [&](const SpatialSight::PlacedVertex& at) {
    const Vec<3> line = at.x - centre;
    const double distance = line.norm();
    if (distance >= radius || at.body != body) return;
    if (at.vertex == source_ || panorama_.shows(at.vertex, line, distance))
      reach(at.vertex, distance, source_);
    else
      hidden_.push_back(at.vertex);
  });
  for (const Index v : hidden_) offer_from_sight(v);
  spread();
}

/// The march begins where what is in sight ends: paths bend at the boundary there, or else at the nearest vertex.
void SpatialMarching::offer_from_sight(Index v) {
  const FineMesh<3>& mesh = sight_.mesh();
  const Vec<3> x = mesh.vertex(v);
  Front first{infinity, -1}, best{infinity, -1};
  for (const auto& [w, cell] : sight_.neighbours(v)) {
    if (states_[w].origin != source_) continue;
    const Front at{states_[w].distance, w};
    if (first < at) first = at;
    if (!mesh.on_boundary(w)) continue;
    if (const Front bent{at.distance + (x - mesh.vertex(w)).norm(), w}; best < bent) best = bent;
  }
  if (first.vertex < 0) return;
  if (const Front bent{first.distance + (x - mesh.vertex(first.vertex)).norm(), first.vertex}; best < bent) best = bent;
  offer(v, best.distance, best.vertex);
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
  const Vec<3> from = sight_.mesh().vertex(origin);
  const double before = states_[origin].distance - sight_.tolerance();
  const bool seen = sight_.sees(near, origin, [&](Index w) {
    const State& state = states_[w];
    if (state.origin == origin) return SpatialSight::in_time;
    // Whose place is nearest is a question of sight alone.
    if (source_ < 0 || state.distance == infinity) return SpatialSight::not_yet;
    const double after = state.distance - before;
    const bool in_time = after <= 0.0 || after * after <= (sight_.mesh().vertex(w) - from).squaredNorm();
    return in_time ? SpatialSight::in_time : SpatialSight::late;
  });
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
