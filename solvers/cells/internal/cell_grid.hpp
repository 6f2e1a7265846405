// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity on a grid of boxes with trilinear displacements, without a matrix.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// By set of parts (bit q: part q = x + 2 y + 4 z): the largest eigenvalue of the stiffness of a cell with material in
/// these parts, over its diagonal.
using CellEigenvalues = std::array<float, 256>;
/// For a ratio across / shear between two values. Cells of any size, but of these proportions.
CellEigenvalues largest_eigenvalues(const Vec<3>& edges, float least, float most);

/// A grid of boxes and its nodes, x fastest. Rows of nodes are padded so that `lanes` cells can be taken at once.
struct CellLayout {
  static constexpr int lanes = 8;

  std::array<Index, 3> cells{};
  Vec<3> edges = Vec<3>::Ones();  ///< of a cell [length]
  std::array<double, 3> inverse_edges{};
  Index row = 0, pitch = 0;  ///< cells in a padded row, nodes in one

  CellLayout(const std::array<Index, 3>& cells, const Vec<3>& edges);

  std::size_t node(Index i, Index j, Index k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(pitch) * (j + static_cast<std::size_t>(cells[1] + 1) * k);
  }
  std::size_t nodes() const { return node(0, 0, cells[2] + 1); }
  std::size_t block(Index i, Index j, Index k) const {
    return (static_cast<std::size_t>(i) +
            static_cast<std::size_t>(row) * (j + static_cast<std::size_t>(cells[1]) * k)) /
           lanes;
  }
};

/// A body in a grid of cells (finite cells; Parvizian, Duester & Rank 2007): strains are taken at eight points of a
/// cell, the centres of its octants ("parts"), each weighted with the stiffness of the material in its octant. So cells
/// that are partly void are no thicker than their material, and whole ones bend more easily (by a quarter) than with
/// exact integration. Constant strains are integrated exactly.
///
/// Fields have three components one after the other, each by node.
struct CellGrid : CellLayout {
  std::vector<float> stiffness;  ///< by `lanes` cells: shear of their 8 parts and across of their 8 parts, times volume
  std::vector<char> empty;       ///< by `lanes` cells

  /// Isotropic stiffness by part, C_xyxy (`shear`) and C_xxyy (`across`), x fastest, two parts to a cell along each
  /// axis.
  CellGrid(const std::array<Index, 3>& cells, const Vec<3>& edges, const std::vector<float>& shear,
           const std::vector<float>& across);

  std::size_t size() const { return 3 * nodes(); }
  /// shear of part q = x + 2 y + 4 z of a cell, times its volume; across with q + 8.
  float weight(Index i, Index j, Index k, int q) const {
    return stiffness[(block(i, j, k) * 16 + q) * lanes + i % lanes];
  }

  /// f = K u. Bitwise the same on any number of threads.
  void apply(const float* u, float* f) const;
  void apply(const double* u, double* f) const;
  /// The same for `count` fields, for which the stiffness is read once.
  void apply(const float* const* u, float* const* f, int count) const;
  void apply(const double* const* u, double* const* f, int count) const;
  /// A diagonal D, laid out as a field, with x^T K x <= x^T D x for all x: that of K, cell by cell times the largest
  /// eigenvalue that its part of K has over it.
  std::vector<float> bound(const CellEigenvalues& eigenvalues) const;
};

/// Stiffness by part of a coarser grid, from those of a grid of so many cells: `ratio`, 1 or 2 along each axis.
std::vector<float> halved(const std::vector<float>& parts, const std::array<Index, 3>& cells,
                          const std::array<int, 3>& ratio);

}  // namespace efree::internal
