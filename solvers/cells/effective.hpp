// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective stiffness and conductivity of what an image shows: the tensor between mean stress and mean strain.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/geometry/input/label_image.hpp"
#include "efree/materials/material.hpp"
#include "efree/solvers/algorithms/unit_cell.hpp"

#include <functional>
#include <vector>

namespace efree {

/// How fine and how exact an effective tensor is.
struct EffectiveOptions {
  FrameCondition frame = FrameCondition::periodic;
  /// Wanted edge of a cell [length]; a whole part or a multiple of a voxel is taken. 0: a voxel, half of one where
  /// voxels are few (a quarter if they are taken as they are), more where memory is short.
  double size = 0.0;
  /// Whether boundaries between labels are taken to be smooth, planes within voxels (box_averages); else they are the
  /// faces of voxels. Of materials that differ from place to place they are smooth.
  bool smooth = true;
  /// Of the iterations: relative error in the energy norm. That of the tensor is its square. 0: a twentieth of the root
  /// of what the grid differs by from the one before, which is a 400th of that in the tensor, and at least 5e-5.
  double tolerance = 0.0;
  int most = 300;  ///< iterations on a grid after which it is given up
  int loads = 0;   ///< how many columns of the tensor are computed, the others are 0; 0: all (measurements only)
};

/// What was found on one grid.
struct EffectiveLevel {
  Vec<3> edges;          ///< of a cell [length]
  Index cells = 0;       ///< of the grid, void included
  int iterations = 0;    ///< of the load that took most
  Matrix tensor{};       ///< as EffectiveTensor::tensor
  double seconds = 0.0;  ///< of the iterations
};

/// Stiffness: 6 x 6 by xx, yy, zz, yz, xz, xy with doubled shear strains [stress]. Conductivity: 3 x 3.
struct EffectiveTensor {
  Matrix tensor{};                       ///< symmetric, from energies: <e_i : C e_j>
  std::vector<EffectiveLevel> levels{};  ///< from fine to coarse
  /// Relative error (Frobenius norm, Kelvin's notation) that the grid leaves, from the tensors of three grids.
  double grid_error = 0.0;
  double iteration_error = 0.0;  ///< what the iterations leave, likewise
  /// Difference of the mean stresses from symmetry, |T - T^T| / |T|: `tensor` is symmetric by construction, this is
  /// not.
  double asymmetry = 0.0;
  Matrix extrapolated{};  ///< to cells without size, at the rate of the last three grids; not of cells of more voxels
  Matrix mean{};          ///< stiffness (conductivity) averaged over the frame, void included: Voigt's bound

  const EffectiveLevel& finest() const { return levels.front(); }
};

/// Sets grid_error (by a norm of tensors) and extrapolated from the tensors of three levels, each about twice as coarse
/// as the one before; coarsening(a, b): how much coarser level b is than level a. Where cells mix several voxels
/// (`is_mixed`) errors of flat interfaces depend on how they happen to cut cells: then differences do not fall
/// steadily, and the last one alone says too little. Rates are between `slowest` and 2.
void estimate_grid_error(EffectiveTensor& result, const std::function<double(const Matrix&)>& norm,
                         const std::function<double(std::size_t, std::size_t)>& coarsening, bool is_mixed,
                         double slowest);

/// Effective stiffness of an image, `materials` by label, label 0 void; along the image's axes. Trilinear
/// displacements on a grid of equal cells as of solve_on_cells, with the boundaries inside voxels that box_averages
/// sees; where the material changes on faces of voxels only, cells of a voxel represent it exactly. Six mean strains
/// (stresses) on one hierarchy of grids: conjugate gradients preconditioned by geometric multigrid, each grid
/// begins with what the coarser one found. Grids need not have even numbers of cells.
///
/// Bodies that nothing connects to the others, and void that cuts all of them, leave parts of the tensor zero. Bitwise
/// the same on any number of threads; memory: about 500 bytes to a cell, and 40 for each anisotropic material.
///
/// Stages: assembly, solve. Throws InputError for a broken image, a label without material or with one that is
/// anisotropic and differs from place to place by more than a factor, an image that is all void, void at the frame
/// under uniform tractions, or too little memory; NumericalError if the iterations break down or do not end.
EffectiveTensor effective_stiffness(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                    const EffectiveOptions& options = {}, const Monitor& monitor = {});

/// Effective conductivity, of heat, charge or whatever flows along the gradient of a potential: `conductivities` by
/// label, 0 for insulators; otherwise as effective_stiffness. Under `uniform` the mean flux is applied. Throws
/// InputError also for a conductivity that is negative or not finite.
EffectiveTensor effective_conductivity(const LabelImage<3>& image, const std::vector<double>& conductivities,
                                       const EffectiveOptions& options = {}, const Monitor& monitor = {});

}  // namespace efree
