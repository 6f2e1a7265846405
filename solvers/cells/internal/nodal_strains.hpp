// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacements and strains of a solution on cells, at any place.
#pragma once

#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/cell_solver.hpp"
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// The points of a grid as a row of columns.
struct GridPoints {
  const Lattice& grid;
  std::array<Index, 3> size{grid.cubes[0] + 1, grid.cubes[1] + 1, grid.cubes[2] + 1};
  Eigen::Index at(Index i, Index j, Index k) const {
    return i + static_cast<Eigen::Index>(size[0]) * (j + static_cast<Eigen::Index>(size[1]) * k);
  }
};

/// A cell and a place in it.
struct Place {
  std::array<Index, 3> cell;
  Vec<3> t;  ///< 0 to 1 along each axis
  double weight(int corner) const {
    double w = 1.0;
    for (int d = 0; d < 3; ++d) w *= corner >> d & 1 ? t[d] : 1.0 - t[d];
    return w;
  }
};
/// Of a point of the world: in the nearest cell of a grid that is turned so about its origin.
Place place_of(const Lattice& grid, const Mat<3>& axes, const Vec<3>& x);

/// Interpolates a displacement at the points of a grid.
Vec<3> displacement_in(const GridPoints& points, const Points<3>& displacement, const Place& place);

/// How much of a region is in the octants of the cells of some layers.
class RegionShare {
 public:
  /// `averages`: of 1 for the region's labels and 0 for others, over octants. Of the layers [first, last) of cells.
  RegionShare(const BoxAverages& averages, const std::array<Index, 3>& cells, Index first, Index last)
      : order_(cells), first_(first), part_(averages.layers(2 * first, 2 * last)) {
    constexpr float rounding = 1e-5F;
    for (float& part : part_)
      if (part > 1.0F - rounding) part = 1.0F;
  }
  /// In octant q = x + 2 y + 4 z of a cell.
  float at(const std::array<Index, 3>& cell, int q) const {
    return part_[order_(cell[0], cell[1], cell[2] - first_, q)];
  }
  bool is_whole(const std::array<Index, 3>& cell) const {
    for (int q = 0; q < 8; ++q)
      if (at(cell, q) != 1.0F) return false;
    return true;
  }

 private:
  PartOrder order_;
  Index first_;
  std::vector<float> part_;
};

/// Strains at the points of some layers of a grid from those at the points of the cells around, weighted with how much
/// of a region is there: linear fits, means where there is too little for one.
class NodalStrains {
 public:
  /// Of the layers [first, last) of points; `share` has the layers of cells on both sides of these.
  NodalStrains(const CellSolution& solution, const RegionShare& share, Index first, Index last);
  /// At a place whose cell's corners are in these layers: a corner without material counts if no other has some.
  Voigt<3> at(const Place& place) const;

 private:
  GridPoints points_;
  Eigen::Index before_;  ///< points in the layers below
  Matrix strains_;       ///< 6 x points, in the world's axes; without any of the region not a number
};

}  // namespace efree::internal
