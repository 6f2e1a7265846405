// SPDX-License-Identifier: GPL-3.0-or-later
/// Distances through a tetrahedral mesh that spread from vertex to vertex along lines of sight.
#pragma once

#include "efree/geometry/fine_mesh.hpp"
#include "efree/heatgeo/front.hpp"
#include "efree/heatgeo/patch.hpp"

namespace efree {

/// What marches through one mesh share: the neighbours of every vertex, and the test of lines of sight. Immutable.
class SpatialSight {
 public:
  /// Keeps a reference. Cost linear in the mesh.
  explicit SpatialSight(const FineMesh<3>& mesh);

  const FineMesh<3>& mesh() const { return mesh_; }
  double tolerance() const { return tolerance_; }
  /// Vertices that share an edge with v, ascending.
  std::span<const Index> neighbours(Index v) const { return neighbours_[v]; }
  /// Cell at v that the straight line from v to x enters, and the local number of v there; cell -1 if the line leaves
  /// the body at once. x is a place other than that of v.
  struct Start {
    Index cell = -1;
    int corner = 0;
  };
  Start start(Index v, const Vec<3>& x) const;
  /// Whether the line goes on from there to vertex `target` without leaving the body: a walk from cell to cell
  /// (visibility walk of Devillers, Pion & Teillaud 2002). Lines along the boundary are inside.
  bool reaches(Start from, Index target) const;

 private:
  /// Twice the area of the facet opposite corner i of cell c times the height of x over it; positive inside.
  double side(Index c, int i, const Vec<3>& x) const;
  bool beyond(Index c, int i, const Vec<3>& x) const;

  const FineMesh<3>& mesh_;
  double tolerance_;
  Ragged<Index> neighbours_;
};

/// Lower bounds, by direction, on the distance from a point to the facets that show it their outer side: a cube map.
/// What is nearer than the bound of its direction is in sight. Keeps its memory: use one per thread.
class Horizon {
 public:
  Horizon();
  /// Looks around from the patch's source.
  void look(const FineMesh<3>& mesh, const Patch<3>& patch);
  /// `line` leads from the source to a point at `distance`.
  bool in_sight(const Vec<3>& line, double distance) const;

 private:
  static constexpr int resolution = 12;  ///< squares along an edge of the cube
  void lower(const Vec<3>& a, const Vec<3>& b, const Vec<3>& c);

  std::vector<double> bounds_;      ///< 6 x resolution^2
  std::vector<Vec<3>> directions_;  ///< of the squares' middles
  bool blind_ = false;              ///< the source lies on a slit: nothing is known
};

/// Fast marching with virtual sources (Sethian 1996; Novotni & Klein 2002) in space: Dijkstra's order, but a vertex
/// inherits the origin of its neighbour (a source, or the boundary vertex where the path bent last) and takes the
/// straight distance to it wherever the line of sight is free. Exact where a source is in sight; behind an edge the
/// path bends at fine vertices. Keeps scratch memory: use one per thread.
class SpatialMarching {
 public:
  /// Keeps a reference.
  explicit SpatialMarching(const SpatialSight& sight);

  /// Spreads from the patch's source to its radius. What the horizon shows to be in sight is not marched to.
  void march(const Patch<3>& patch);
  /// Spreads from all `sources` at once through the body, to vertices nearer than `radius`.
  void march(std::span<const Index> sources, double radius);

  /// Vertices reached by the last march, in no special order; `distance` and `origin` hold for them.
  const std::vector<Index>& reached() const { return reached_; }
  double distance(Index v) const { return distance_[v]; }
  /// Vertex from which the path comes straight to v; a source is its own origin. Never farther than v itself.
  Index origin(Index v) const { return origin_[v]; }

 private:
  void clear(double radius);
  void reach(Index v, double distance, Index origin);
  void spread();
  bool sees(Index v, Index origin) const;
  void offer(Index v, double distance, Index origin);

  const SpatialSight& sight_;
  double radius_ = 0.0;
  std::vector<double> distance_;
  std::vector<Index> origin_, reached_;
  std::vector<Front> front_;
  Horizon horizon_;
  std::vector<Index> hidden_;
};

}  // namespace efree
