// SPDX-License-Identifier: GPL-3.0-or-later
/// What can be seen from one vertex.
#pragma once

#include "efree/heatgeo/internal/patch.hpp"
#include "efree/heatgeo/internal/sight_lines.hpp"

namespace efree {

/// Answers whether one vertex sees others, many times from the same place: the boundary facets that can hide something
/// are sorted by direction and distance, so that an answer costs a look at the few in its direction. Where rounding
/// could matter (lines that graze a corner, run along a side or end on a slit) SightLines decides. Keeps scratch
/// memory: use one per thread.
class Viewpoint {
 public:
  /// Keeps a reference.
  explicit Viewpoint(const SightLines& sight);

  /// Looks from vertex `origin` at what lies in the box, which must hold the origin; only in the directions of the
  /// wedge, if there is one.
  void look(Index origin, const VertexGrid<2>::Box& box, const BendingWedge* wedge = nullptr);
  /// False if everything in the box is seen (and part of the same body): no facet shows its outer side, and the origin
  /// has no twin across a slit.
  bool obstructed() const { return obstructed_; }
  /// True if the straight segment from the origin to vertex v in the box stays in the body; `line` is that segment.
  bool sees(Index v, const Vec<2>& line, double length) const;

 private:
  enum class Verdict { hidden, doubtful, seen };

  /// Directions in which the body continues from a vertex.
  struct Opening {
    enum { everywhere, convex, reflex, several } kind;  ///< several: parts of the body touch there
    Vec<2> to_next, to_previous;                        ///< sides of the corner
  };
  /// Facet that can hide what is behind it: seen from its outer side, or edge-on.
  struct Screen {
    double distance;     ///< nothing nearer is hidden
    Vec<2> left, right;  ///< its ends, from the origin
    double extent;       ///< at least |left| + its length
    Index left_vertex, right_vertex;
    bool outer;  ///< surely its outer side
  };

  void add(Index left_vertex, const Vec<2>& left, Index right_vertex, const BendingWedge* wedge);
  void sort_into_sectors();
  Verdict judge(Index v, const Vec<2>& line, double length) const;
  Opening opening(Index v) const;
  Verdict leave(const Opening& opening, const Vec<2>& line, double length) const;

  const SightLines& sight_;
  VertexGrid<2> boundary_;
  double longest_facet_ = 0.0;
  double doubt_;  ///< rounding is surely below this length
  Index origin_ = -1;
  Vec<2> position_;
  Opening opening_;
  bool obstructed_ = false;
  std::vector<Screen> screens_;
  Ragged<Index> sectors_;                        ///< screens in each sector of directions, by distance
  std::vector<std::pair<int, int>> ranges_;      ///< first and last sector of each screen
  std::vector<std::pair<double, Index>> order_;  ///< screens by distance
  std::vector<Index> cursor_;
};

}  // namespace efree
