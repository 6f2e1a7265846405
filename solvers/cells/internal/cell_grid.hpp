// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity on a grid of boxes with trilinear displacements, without a matrix.
#pragma once

#include "efree/solvers/cells/internal/cell_anisotropy.hpp"
#include "efree/solvers/cells/internal/cell_parts.hpp"

#include <array>
#include <vector>

namespace efree::internal {

/// By set of parts (bit q: part q = x + 2 y + 4 z): the largest eigenvalue of the stiffness of a cell with material in
/// these parts, over its diagonal.
using CellEigenvalues = std::array<float, 256>;
/// The least of the sets that are mirror images of a set of parts, and have its eigenvalues.
int mirrored(int set);
/// For ratios across / shear between two values. Cells of any size, but of these proportions.
CellEigenvalues largest_eigenvalues(const Vec<3>& edges, const std::array<float, 2>& ratios);

/// Of which dilatation pressures are: at each point its own, or in each cell the mean, weighted with C_xxyy, so that
/// nearly incompressible materials do not lock (selective reduced integration; Malkus & Hughes 1978).
enum class Dilatation { local, mean };
/// C_xxyy over C_xyxy beyond which cells lock: that of nu = 0.4.
inline constexpr float bearable_ratio = 4.001F;

/// A body in a grid of cells (finite cells; Parvizian, Duester & Rank 2007): strains are taken at eight points of a
/// cell, the centres of its octants ("parts"), each weighted with the stiffness of the material in its octant. So cells
/// that are partly void are no thicker than their material, and whole ones bend more easily (by a quarter) than with
/// exact integration. Constant strains are integrated exactly.
///
/// Fields have three components one after the other, each by node.
struct CellGrid : CellLayout {
  CellAnisotropy anisotropy;
  CellParts parts;

  /// Isotropic stiffness by part; `exact` as of CellParts. `anisotropic`: what materials have beyond that, C - C_iso
  /// along the grid's axes, none of which is negative; `layers` have their shares.
  CellGrid(const std::array<Index, 3>& cells, const Vec<3>& edges, const PartLayers& layers,
           const std::vector<PartStiffness>& exact = {}, const std::vector<VoigtMatrix<3>>& anisotropic = {});

  std::size_t size() const { return 3 * nodes(); }
  /// Of part q = x + 2 y + 4 z of a cell.
  const PartStiffness& moduli(Index i, Index j, Index k, int q) const {
    return parts.moduli(block(i, j, k), i % lanes, q);
  }
  const PartStiffness& weight(Index i, Index j, Index k, int q) const {
    return parts.weight(block(i, j, k), i % lanes, q);
  }
  bool has_material(Index i, Index j, Index k) const {
    if (parts.is_empty(block(i, j, k))) return false;
    for (int q = 0; q < 8; ++q)
      if (moduli(i, j, k, q).shear > 0.0F) return true;
    return false;
  }
  /// Moduli and shares of the layers [begin, end) of cells.
  Parts layers(Index begin, Index end) const;

  /// f = K u. Bitwise the same on any number of threads.
  void apply(const float* u, float* f, Dilatation dilatation = Dilatation::local) const;
  void apply(const double* u, double* f, Dilatation dilatation = Dilatation::local) const;
  /// f = K_iso u of the isotropic parts alone, which is what preconditioners know.
  void apply_isotropic(const float* u, float* f, Dilatation dilatation) const;
  void apply_isotropic(const double* u, double* f, Dilatation dilatation) const;
  /// By which nearly incompressible materials among the parts do not lock.
  Dilatation needed() const { return parts.ratios()[1] > bearable_ratio ? Dilatation::mean : Dilatation::local; }
  /// A diagonal D, laid out as a field, with x^T K_iso x <= x^T D x for all x and both dilatations: that of K_iso, cell
  /// by cell times the largest eigenvalue that its part of K_iso has over it.
  std::vector<float> bound(const CellEigenvalues& eigenvalues) const;
};

}  // namespace efree::internal
