// SPDX-License-Identifier: GPL-3.0-or-later
/// The part of the fine mesh that a node's support can reach.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

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
template <int Dim> bool shows_outer_side(const FineMesh<Dim>& mesh, Index f, const Vec<Dim>& source, double tolerance);

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

/// Finds vertices by where they are, wherever the boundary is: a regular grid of squares (cubes in 3D) with about eight
/// vertices each. Immutable.
template <int Dim> class VertexGrid {
 public:
  using Box = Eigen::AlignedBox<double, Dim>;

  VertexGrid(const FineMesh<Dim>& mesh, const std::vector<Index>& vertices);
  /// Of all vertices.
  explicit VertexGrid(const FineMesh<Dim>& mesh);

  /// Calls body(v, position) for every vertex in the box, and for some around it. Cost linear in their number.
  template <class Body> void for_each(const Box& box, const Body& body) const {
    for_each(
        box, [](const Vec<Dim>&, double) { return true; }, body);
  }
  /// The same without the squares for which meets(centre, half their diagonal) is false.
  template <class Meets, class Body> void for_each(const Box& box, const Meets& meets, const Body& body) const {
    const Square low = square(box.min()), high = square(box.max());
    const double half_diagonal = 0.5 * std::sqrt(Dim) * width_;
    for (Square at = low; at[Dim - 1] <= high[Dim - 1];) {
      if (meets(origin_ + width_ * (at.template cast<double>() + 0.5).matrix(), half_diagonal))
        for (const Item& item : squares_[number(at)]) body(item.vertex, item.position);
      ++at[0];
      for (int d = 0; d + 1 < Dim && at[d] > high[d]; ++d) at[d] = low[d], ++at[d + 1];
    }
  }

 private:
  struct Item {
    Vec<Dim> position;
    Index vertex;
  };
  using Square = Eigen::Array<Index, Dim, 1>;
  /// Of the square that holds x, clamped to the grid.
  Square square(const Vec<Dim>& x) const;
  /// Row by row.
  Index number(const Square& at) const {
    Index result = at[Dim - 1];
    for (int d = Dim - 2; d >= 0; --d) result = result * count_[d] + at[d];
    return result;
  }

  Vec<Dim> origin_;
  double width_;
  Square count_;
  Ragged<Item> squares_;
};

}  // namespace efree
