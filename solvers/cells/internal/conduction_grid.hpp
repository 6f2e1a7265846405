// SPDX-License-Identifier: GPL-3.0-or-later
/// Conduction on a grid of boxes with trilinear temperatures, without a matrix.
#pragma once

#include "efree/solvers/cells/internal/cell_grid.hpp"

#include <vector>

namespace efree::internal {

/// As CellGrid, with one component and the conductivity of each part instead of its stiffness.
struct ConductionGrid : CellLayout {
  std::vector<float> conductivity;  ///< by `lanes` cells: of their 8 parts, times volume
  std::vector<char> empty;          ///< by `lanes` cells

  /// Conductivity by part, x fastest, two parts to a cell along each axis.
  ConductionGrid(const std::array<Index, 3>& cells, const Vec<3>& edges, const std::vector<float>& parts);

  /// Conductivity of part q = x + 2 y + 4 z of a cell, times its volume.
  float weight(Index i, Index j, Index k, int q) const {
    return conductivity[(block(i, j, k) * 8 + q) * lanes + i % lanes];
  }
  /// f = K u for `count` fields. Bitwise the same on any number of threads.
  void apply(const float* const* u, float* const* f, int count) const;
  void apply(const double* const* u, double* const* f, int count) const;
  /// As CellGrid::bound; the eigenvalues are those of conduction.
  std::vector<float> bound(const CellEigenvalues& eigenvalues) const;
};

/// By set of parts: the largest eigenvalue of the conduction matrix of a cell over its diagonal. Cells of any size, but
/// of these proportions.
CellEigenvalues largest_conduction_eigenvalues(const Vec<3>& edges);

}  // namespace efree::internal
