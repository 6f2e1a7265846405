// SPDX-License-Identifier: GPL-3.0-or-later
/// Exact distances inside a planar body.
#pragma once

#include "efree/heatgeo/internal/viewpoint.hpp"

namespace efree {

/// Shortest distances inside a planar body, exact up to rounding, from one vertex to those in reach: straight lines,
/// and paths that bend at reflex corners of the boundary (visibility graph, Lozano-Perez & Wesley 1979, in Dijkstra's
/// order, with only the bends a taut string makes). What a corner sees in the directions of its bends is found once and
/// remembered for the next sources. Keeps scratch memory: use one per thread.
class VisibleDistance {
 public:
  /// Keeps a reference.
  explicit VisibleDistance(const SightLines& sight);

  /// Finds the vertices nearer to `source` than `radius`.
  void measure(Index source, double radius);

  /// Vertices found last, in no special order; `distance` holds for them.
  const std::vector<Index>& reached() const { return reached_; }
  double distance(Index v) const { return distance_[v]; }

 private:
  /// Bends still to be gone through, the nearest one on top.
  struct Bend {
    double distance;
    Index vertex;
    Vec<2> came_from;
    friend bool operator<(const Bend& a, const Bend& b) {
      return a.distance != b.distance ? a.distance > b.distance : a.vertex > b.vertex;
    }
  };
  using Seen = std::vector<std::pair<double, Index>>;  // distance and vertex
  /// What a corner sees in the directions of its bends, nearest first.
  struct Fan {
    double reach = 0.0;
    Seen seen;
  };

  void offer(Index v, double distance, const Vec<2>& came_from);
  void bend(const Bend& at);
  const Seen& fan(Index vertex, Index number, const Corner& corner);

  const SightLines& sight_;
  VertexGrid<2> grid_;
  Viewpoint viewpoint_;
  double radius_ = 0.0;
  std::vector<double> distance_;
  std::vector<Index> reached_;
  std::vector<Bend> bends_;
  std::vector<Fan> fans_;  ///< one for each corner
  Seen seen_;
};

}  // namespace efree
