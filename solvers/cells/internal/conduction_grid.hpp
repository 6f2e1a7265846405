// SPDX-License-Identifier: GPL-3.0-or-later
/// Conduction on a grid of boxes with trilinear temperatures, without a matrix.
#pragma once

#include "efree/solvers/cells/internal/cell_grid.hpp"

#include <vector>

namespace efree::internal {

/// As CellGrid, with one component and the conductivity of each part instead of its stiffness.
struct ConductionGrid : CellLayout {
  CellParts parts;

  /// Conductivity by part; `exact` as of CellParts.
  ConductionGrid(const std::array<Index, 3>& cells, const Vec<3>& edges, const PartLayers& layers,
                 const std::vector<PartStiffness>& exact = {});

  /// f = K u. Bitwise the same on any number of threads.
  void apply(const float* u, float* f) const;
  void apply(const double* u, double* f) const;
  /// As CellGrid::bound; the eigenvalues are those of conduction.
  std::vector<float> bound(const CellEigenvalues& eigenvalues) const;
};

/// By set of parts: the largest eigenvalue of the conduction matrix of a cell over its diagonal. Cells of any size, but
/// of these proportions.
CellEigenvalues largest_conduction_eigenvalues(const Vec<3>& edges);

}  // namespace efree::internal
