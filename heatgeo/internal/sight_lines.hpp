// SPDX-License-Identifier: GPL-3.0-or-later
/// Which vertices of a planar body see each other, and where shortest paths bend.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <array>
#include <optional>

namespace efree {

/// a x b, the component out of the plane.
inline double cross(const Vec<2>& a, const Vec<2>& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// Where the boundary passes a vertex: it comes from `previous` and goes on to `next`, the body on its left.
struct Corner {
  Index previous, next;
  bool reflex;  ///< the body's angle is more than 180 degrees: shortest paths can bend here
};

/// Directions in which a shortest path may go on that bends at a reflex corner: counterclockwise from `first` to
/// `last`, less than 180 degrees apart.
struct BendingWedge {
  Vec<2> first, last;  ///< unit vectors, or both zero
  double slack;        ///< [length]
  /// `margin` widens the wedge on either side [length].
  bool contains(const Vec<2>& direction, double margin = 0.0) const {
    return after_first(direction, margin) && before_last(direction, margin);
  }
  /// True only if no point of the segment from a to b is in the wedge (the converse does not hold).
  bool misses(const Vec<2>& a, const Vec<2>& b) const {
    return (!after_first(a, 0.0) && !after_first(b, 0.0)) || (!before_last(a, 0.0) && !before_last(b, 0.0));
  }

 private:
  bool after_first(const Vec<2>& d, double margin) const {
    return first.x() * d.y() - first.y() * d.x() >= -slack - margin;
  }
  bool before_last(const Vec<2>& d, double margin) const {
    return last.x() * d.y() - last.y() * d.x() <= slack + margin;
  }
};

/// Straight lines through a planar triangulation. A segment is followed from cell to cell, so the two sides of a slit
/// are told apart although their vertices coincide; vertices closer to the segment than rounding count as lying on it,
/// so a straight side of the body does not hide its own vertices. Immutable.
class SightLines {
 public:
  /// Keeps a reference to the mesh.
  explicit SightLines(const FineMesh<2>& mesh);

  const FineMesh<2>& mesh() const { return mesh_; }
  double tolerance() const { return tolerance_; }

  /// True if the straight segment between two vertices stays in the body; it does not go on through a point where two
  /// parts of the body touch. Cost linear in the cells it crosses.
  bool visible(Index from, Index to) const;

  /// Corners of the boundary at vertex v: none inside the body, one on its boundary, more where parts touch in a point.
  std::span<const Corner> corners(Index v) const { return corners_[v]; }
  /// Number of the first of them; corners are numbered through the mesh, num_corners() in all.
  Index first_corner(Index v) const { return corners_.offsets[v]; }
  Index num_corners() const { return static_cast<Index>(corners_.items.size()); }
  /// Whether one of them is reflex.
  bool is_reflex(Index v) const { return reflex_[v] != 0; }

  /// Where a path that came to v straight from the point `from` may go on after bending at the corner, if anywhere
  /// (taut string: it bends towards the obstacle, and no further than the obstacle's side). Good for directions no
  /// longer than `reach`.
  std::optional<BendingWedge> bend(Index v, const Corner& corner, const Vec<2>& from, double reach) const;
  /// The two wedges, one for each way around the obstacle, that hold all directions `bend` can give at a reflex corner.
  std::array<BendingWedge, 2> bends(Index v, const Corner& corner, double reach) const;

 private:
  /// How a ray leaves a vertex: along one or (at the tip of a slit) two edges, or through a cell's opposite facet.
  struct Departure {
    Index along = -1, also_along = -1;
    Index cell = -1, facet = -1;
  };
  Departure depart(Index v, const Vec<2>& direction) const;
  /// First vertex on the line from `origin` after leaving `cell` through its facet; -1 where the line leaves the body.
  Index next_on_line(const Vec<2>& origin, const Vec<2>& direction, Index cell, Index facet) const;

  /// Whether a direction points into the body at this corner, or along one of its sides.
  bool opens(Index v, const Corner& corner, const Vec<2>& direction) const;
  /// Whether a line goes on in the same part of the body: parts that touch in a point do not see each other through it.
  bool passes(Index v, const Vec<2>& direction) const;

  const FineMesh<2>& mesh_;
  double tolerance_;
  Ragged<Corner> corners_;
  std::vector<char> reflex_;  ///< per vertex
};

}  // namespace efree
