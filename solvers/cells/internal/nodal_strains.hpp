// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacements and strains of a solution on cells, at any place.
#pragma once

#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

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

/// The octants of cells.
inline std::array<Index, 3> octants_of(const std::array<Index, 3>& cells) {
  return {2 * cells[0], 2 * cells[1], 2 * cells[2]};
}
inline BoxRange octants_of(const BoxRange& cells) {
  return {octants_of(cells.begin), octants_of(cells.end)};
}

/// How much of a region is in the octants of some cells.
class RegionShare {
 public:
  /// `averages`: of 1 for the region's labels and 0 for others, over octants.
  RegionShare(const BoxAverages& averages, const BoxRange& cells)
      : cells_(cells), octants_(octants_of(cells)), part_(averages.in(octants_)) {
    constexpr float rounding = 1e-5F;
    for (float& part : part_)
      if (part > 1.0F - rounding) part = 1.0F;
  }
  const BoxRange& cells() const { return cells_; }
  const BoxRange& octants() const { return octants_; }
  /// By octant, to be shared out between regions.
  std::vector<float>& parts() { return part_; }
  /// In octant q = x + 2 y + 4 z of one of these cells.
  float at(const std::array<Index, 3>& cell, int q) const {
    return part_[octants_.index({2 * cell[0] + (q & 1), 2 * cell[1] + (q >> 1 & 1), 2 * cell[2] + (q >> 2)})];
  }
  bool is_whole(const std::array<Index, 3>& cell) const {
    for (int q = 0; q < 8; ++q)
      if (at(cell, q) != 1.0F) return false;
    return true;
  }

 private:
  BoxRange cells_, octants_;
  std::vector<float> part_;
};

/// Strains of a solution's displacements in its cells, in the world's axes.
class CellStrains {
 public:
  static constexpr int middle = 8;
  explicit CellStrains(const CellSolution& solution);
  /// Displacements of the corners.
  Eigen::Matrix<double, 3, 8> displacements(const std::array<Index, 3>& cell) const;
  /// In the middle of octant q, or of the cell.
  Voigt<3> strain(const Eigen::Matrix<double, 3, 8>& displacements, int q) const;

 private:
  const CellSolution& solution_;
  GridPoints points_;
  bool turned_;
  std::array<Eigen::Matrix<double, 8, 3>, 9> slopes_;  ///< of the corners' functions, in the octants and the middle
};

/// Strains of a region that are recovered from those of the cells. In cells all of whose neighbours are of the region
/// they are those in the middle, where they converge faster than elsewhere (Barlow 1976); in others interpolated
/// between points of the grid, where they are linear fits to those in the octants around, weighted with how much of the
/// region is there; means where there is too little for one.
class NodalStrains {
 public:
  /// Of these cells. `share` has those beside them, too, as far as there are any of the region. `everywhere`: fits at
  /// all points, for `at`; else only at those where they are needed.
  NodalStrains(const CellSolution& solution, const RegionShare& share, const BoxRange& cells, bool everywhere = false);
  /// In the middle of a cell that is all of the region.
  Voigt<3> in_middle(const std::array<Index, 3>& cell) const;
  /// In the middles of the octants of one with some of it.
  Eigen::Matrix<double, 6, 8> in_octants(const std::array<Index, 3>& cell) const;
  /// At a place of a cell: a corner without material counts if no other has some. Only with `everywhere`.
  Voigt<3> at(const Place& place) const;

 private:
  bool is_deep(const std::array<Index, 3>& cell) const { return deep_[cells_.index(cell)] != 0; }
  void find_deep(const RegionShare& share);

  CellStrains strain_;
  BoxRange cells_, points_;
  std::vector<char> deep_;  ///< by cell: all around are of the region
  Matrix strains_;          ///< 6 x points; without any of the region not a number
};

}  // namespace efree::internal
