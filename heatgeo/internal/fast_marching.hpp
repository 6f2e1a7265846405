// SPDX-License-Identifier: GPL-3.0-or-later
/// Distances that spread from vertex to vertex, each vertex remembering where its straight line began.
#pragma once

#include "efree/heatgeo/internal/front.hpp"
#include "efree/heatgeo/internal/sight_lines.hpp"

namespace efree {

/// Fast marching with virtual sources: Dijkstra's order, but a vertex takes its distance from the vertex its straight
/// line comes from (a source, or a reflex corner where the path bent last), so the update has no error where
/// the line crosses the front edge; where two fronts meet, the line of sight is checked. Vertices may be improved after
/// they were passed, so obtuse cells do no harm. After Sethian (1996) and the virtual sources of Novotni & Klein
/// (2002). Exact but near places where several fronts meet inside one cell. Keeps scratch memory: use one per thread.
class FastMarching {
 public:
  /// Keeps a reference.
  explicit FastMarching(const SightLines& sight);

  /// Spreads from all `sources` at once through the body, to vertices nearer than `radius`.
  void march(std::span<const Index> sources, double radius);

  /// Calls body(Reached) for all vertices reached by the last march, in no special order.
  template <class Body> void for_each_reached(const Body& body) const {
    for (const Index v : reached_) body(Reached{v, distance_[v], origin_[v]});
  }
  Index num_reached() const { return static_cast<Index>(reached_.size()); }

 private:
  void offer(Index v, double distance, Index origin);
  void spread_straight(Index a);
  void spread_bent(Index a);
  void cross_edge(Index a, Index b, Index c);

  const SightLines& sight_;
  double radius_ = 0.0;
  std::vector<double> distance_;
  std::vector<Index> origin_, reached_;
  std::vector<Front> front_;
};

}  // namespace efree
