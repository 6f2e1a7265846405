// SPDX-License-Identifier: GPL-3.0-or-later
/// Exact distances inside a planar body.
#pragma once

#include "efree/heatgeo/patch.hpp"
#include "efree/heatgeo/sight_lines.hpp"

namespace efree {

/// Shortest distances inside a planar body, exact up to rounding, from the source of a patch to its vertices: straight
/// lines, and paths that bend at reflex corners of the boundary (visibility graph, Lozano-Perez & Wesley 1979, in
/// Dijkstra's order, with only the bends a taut string makes). Keeps scratch memory: use one per thread.
class VisibleDistance {
 public:
  /// Keeps a reference.
  explicit VisibleDistance(const SightLines& sight);
  /// Distances of patch.vertices; infinite where no path is shorter than patch.radius. Valid until the next call.
  const std::vector<double>& from(const Patch<2>& patch);

 private:
  void build_horizon(const Patch<2>& patch);
  void find_hidden(const Patch<2>& patch);
  void bend_at(Index corner_vertex, double distance, const Vec<2>& came_from);

  struct Hidden {
    Vec<2> position;
    Index vertex;
    Index row;  ///< in patch.vertices
  };
  /// Bends still to be gone through, the nearest one on top.
  struct Bend {
    double distance;
    Index vertex;
    Vec<2> came_from;
    friend bool operator<(const Bend& a, const Bend& b) {
      return a.distance != b.distance ? a.distance > b.distance : a.vertex > b.vertex;
    }
  };

  const SightLines& sight_;
  double radius_ = 0.0;
  std::vector<double> distances_;
  std::vector<double> horizon_;  ///< per sector of directions: distance up to which nothing hides a vertex
  std::vector<Hidden> hidden_;   ///< by x
  std::vector<Bend> bends_;
};

}  // namespace efree
