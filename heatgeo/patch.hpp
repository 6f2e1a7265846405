// SPDX-License-Identifier: GPL-3.0-or-later
/// The part of the fine mesh that a node's support can reach.
#pragma once

#include "efree/geometry/fine_mesh.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace efree {

/// Connected part of the fine mesh inside a ball around a source vertex.
template <int Dim> struct Patch {
  Index source = -1;    ///< fine vertex at the centre
  double radius = 0.0;  ///< of the ball [length]
  std::vector<Index>
      cells;  ///< cells that meet the open ball, connected to the source through facets, in flooding order
  std::vector<Index> vertices;    ///< all vertices of those cells, source first (some lie a little outside the ball)
  std::vector<double> distances;  ///< straight-line distance of each of those vertices from the source [length]
  std::vector<Index> facets;      ///< boundary facets of those cells
  /// True if a boundary facet in reach shows its outer side to the source, or if the far side of a slit lies in reach
  /// at the source itself. Otherwise the source sees all of the patch and the geodesic distance is the straight line: a
  /// segment that left the body would have to come back through such a facet.
  bool obstructed = false;
};

/// Lengths below this are rounding of the vertex coordinates: 1e-12 of the largest one.
template <int Dim> double length_tolerance(const FineMesh<Dim>& mesh);

/// True if `source` lies on the outer side of boundary facet f, by more than rounding.
bool shows_outer_side(const FineMesh<2>& mesh, Index f, const Vec<2>& source, double tolerance);

/// Finds patches; keeps scratch memory between calls, so use one per thread.
template <int Dim> class PatchFinder {
 public:
  /// Keeps a reference to the mesh.
  explicit PatchFinder(const FineMesh<Dim>& mesh);
  /// Cost linear in the size of the patch. The reference is valid until the next call.
  const Patch<Dim>& around(Index source, double radius);

 private:
  bool meets_ball(Index c) const;
  bool is_obstructed() const;

  const FineMesh<Dim>& mesh_;
  double tolerance_;
  Patch<Dim> patch_;
  std::vector<Index> cell_stamp_, vertex_stamp_;
  Index stamp_ = 0;
};

/// Finds vertices by where they are, wherever the boundary is: a regular grid of squares with about eight vertices
/// each. Immutable.
class VertexGrid {
 public:
  using Box = Eigen::AlignedBox<double, 2>;

  VertexGrid(const FineMesh<2>& mesh, const std::vector<Index>& vertices);
  /// Of all vertices.
  explicit VertexGrid(const FineMesh<2>& mesh);

  /// Calls body(v, position) for every vertex in the box, and for some around it. Cost linear in their number.
  template <class Body> void for_each(const Box& box, const Body& body) const {
    for_each(
        box, [](const Vec<2>&, double) { return true; }, body);
  }
  /// The same without the squares for which meets(centre, half their diagonal) is false.
  template <class Meets, class Body> void for_each(const Box& box, const Meets& meets, const Body& body) const {
    const auto low = square(box.min()), high = square(box.max());
    const double half_diagonal = std::sqrt(0.5) * width_;
    for (Index row = low.y(); row <= high.y(); ++row)
      for (Index column = low.x(); column <= high.x(); ++column)
        if (meets(origin_ + width_ * Vec<2>(column + 0.5, row + 0.5), half_diagonal))
          for (const Item& item : squares_[row * columns_ + column]) body(item.vertex, item.position);
  }

 private:
  struct Item {
    Vec<2> position;
    Index vertex;
  };
  /// Column and row, clamped to the grid.
  Eigen::Vector2i square(const Vec<2>& x) const;

  Vec<2> origin_;
  double width_;
  Index columns_, rows_;
  Ragged<Item> squares_;  ///< row by row
};

}  // namespace efree
