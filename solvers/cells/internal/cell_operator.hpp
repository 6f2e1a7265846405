// SPDX-License-Identifier: GPL-3.0-or-later
/// Matrices of grids of cells, of elasticity or conduction.
#pragma once

#include "efree/solvers/cells/internal/cell_stiffness.hpp"
#include "efree/solvers/cells/internal/conduction_grid.hpp"
#include "efree/solvers/cells/internal/grid_fields.hpp"

#include <memory>
#include <vector>

namespace efree::internal {

/// Means over a grid of what fields with mean strains do, by load.
struct CellAverages {
  Matrix energy;  ///< loads x loads: <e_i : C e_j>
  Matrix stress;  ///< strains x loads: <C e_j>
};

/// Moduli of materials before rounding, by what single precision makes of them.
struct ExactStiffness {
  std::vector<PartStiffness> rounded;
  std::vector<std::array<double, 2>> exact;
};

/// f = K u by cells. Strains are xx, yy, zz, yz, xz, xy with doubled shears, or gradients.
class CellOperator {
 public:
  virtual ~CellOperator() = default;
  virtual const CellLayout& layout() const = 0;
  virtual int components() const = 0;
  int strains() const { return components() == 3 ? 6 : 3; }
  std::size_t size() const { return components() * layout().nodes(); }
  /// What its answers are to be of.
  virtual Dilatation dilatation() const = 0;
  /// Bitwise the same on any number of threads.
  virtual void apply(const float* u, float* f, Dilatation dilatation) const = 0;
  virtual void apply(const double* u, double* f, Dilatation dilatation) const = 0;
  /// The same of the isotropic parts of materials, which is what preconditioners know.
  virtual void apply_isotropic(const float* u, float* f, Dilatation dilatation) const = 0;
  virtual void apply_isotropic(const double* u, double* f, Dilatation dilatation) const = 0;
  /// A diagonal that is nowhere less than K of the isotropic parts.
  virtual std::vector<float> bound() const = 0;
  /// f = K E x for a mean strain E, without fluctuations. Returns the stress, integrated over the frame.
  virtual Vector apply_strain(const Vector& strain, Field& f) = 0;
  /// Of the fields E_j x + u_j, E_j column j of `applied`. With exact moduli where parts have them.
  virtual CellAverages averages(const std::vector<Field>& u, const Matrix& applied) = 0;
};

/// K of the parts of a grid; `anisotropic` as of CellGrid; `flat` axes have one cell whose ends are the same node, so
/// that nothing depends on the place along them.
std::unique_ptr<CellOperator> elastic_operator(const std::array<Index, 3>& cells, const Vec<3>& edges,
                                               const std::array<bool, 3>& flat, const PartLayers& layers,
                                               const ExactStiffness& exact,
                                               const std::vector<VoigtMatrix<3>>& anisotropic = {});
std::unique_ptr<CellOperator> conduction_operator(const std::array<Index, 3>& cells, const Vec<3>& edges,
                                                  const std::array<bool, 3>& flat, const PartLayers& layers,
                                                  const ExactStiffness& exact);

}  // namespace efree::internal
