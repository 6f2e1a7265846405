// SPDX-License-Identifier: GPL-3.0-or-later
/// Distances through a tetrahedral mesh that spread from vertex to vertex along lines of sight.
#pragma once

#include "efree/heatgeo/internal/front.hpp"
#include "efree/heatgeo/internal/panorama.hpp"

#include <limits>

namespace efree {

/// Fast marching with virtual sources (Sethian 1996; Novotni & Klein 2002) in space: Dijkstra's order, but a vertex
/// inherits the origin of its neighbour (a source, or the boundary vertex where the path bent last) and takes the
/// straight distance to it wherever the line of sight is free. Exact where a source is in sight; behind an edge the
/// path bends at fine vertices. Keeps scratch memory: use one per thread.
class SpatialMarching {
 public:
  /// Keeps a reference.
  explicit SpatialMarching(const SpatialSight& sight);

  /// Spreads from `source` to the vertices of its body nearer than `radius`. What is in sight is not marched to. The
  /// sight must have been made for patches.
  void march(Index source, double radius);
  /// Spreads from all `sources` at once through the body, to vertices nearer than `radius`.
  void march(std::span<const Index> sources, double radius);

  /// Calls body(Reached) for all vertices reached by the last march, in no special order.
  template <class Body> void for_each_reached(const Body& body) const {
    for (const Index v : reached_) body(Reached{v, states_[v].distance, states_[v].origin});
  }
  Index num_reached() const { return static_cast<Index>(reached_.size()); }

 private:
  void clear(double radius);
  void reach(Index v, double distance, Index origin);
  void offer_from_sight(Index v);
  void spread();
  bool sees(const SpatialSight::Neighbour& near, Index origin);
  void offer(Index v, double distance, Index origin);

  const SpatialSight& sight_;
  double radius_ = 0.0;
  Index source_ = -1;  ///< what it sees is known
  struct State {
    double distance;
    Index origin;  ///< or -1
    Index unseen;  ///< the last origin that it was found not to see, or -1
  };
  static constexpr State unreached{std::numeric_limits<double>::infinity(), -1, -1};
  std::vector<State> states_;
  std::vector<Index> reached_;
  std::vector<Front> front_;
  Panorama panorama_;
  std::vector<Index> hidden_;
};

}  // namespace efree
