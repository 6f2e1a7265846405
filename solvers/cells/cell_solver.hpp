// SPDX-License-Identifier: GPL-3.0-or-later
/// Linear elasticity of images on a regular grid, without a mesh and without a matrix.
#pragma once

#include "efree/assembly/loads.hpp"
#include "efree/core/error.hpp"
#include "efree/core/monitor.hpp"
#include "efree/geometry/input/image_boundary.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/materials/material.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <string>
#include <vector>

namespace efree {

/// Whether a material is isotropic at X, as cells take it. Throws InputError for none.
bool is_isotropic(const SharedMaterial& material, const Vec<3>& X);
/// Whether the stiffness of a material at Y is that at X times a factor.
bool is_multiple(const SharedMaterial& material, const Vec<3>& X, const Vec<3>& Y);

/// Bulk over shear modulus up to which cells can be solved: that of nu = 0.499.
inline constexpr double bearable_on_cells = 500.0;

/// Memory that solve_on_cells takes [bytes to a point of the grid], load_memory for each case that has loads, and,
/// where there are anisotropic materials, anisotropic_memory and material_memory for each of these.
inline constexpr double cell_memory = 138.0, load_memory = 24.0, anisotropic_memory = 40.0, material_memory = 5.0;

/// How fine and how exact a solution on cells is.
struct CellOptions {
  double size = 0.0;        ///< wanted edge of a cell [length]; 0: two voxels
  double tolerance = 5e-4;  ///< of the iterations: relative error in the energy norm
  int most = 400;           ///< iterations on a grid after which it is given up
  bool half_voxel = false;  ///< also say what half a voxel changes
  bool held = false;        ///< refuse a problem whose largest body may move as a whole
  VoxelParts parts{};       ///< parts of the boundary besides those that an ImageBoundary names
};

/// A body that is loaded, or the largest one, and free to move on a grid: nothing holds it, or parts that are smaller
/// than its cells.
struct FreeBody : InputError {
  using InputError::InputError;
};

/// Bodies of an image that are not what they are on a grid: cells with a point in common are one body there.
struct BodiesOnGrid {
  Index left_out = 0;          ///< that nothing holds and nothing loads
  double left_out_part = 0.0;  ///< of the cells with material
  Vec<3> left_out_at{};        ///< a corner of a cell of the largest, in the world
  int free_motions = 0;        ///< of the largest that something holds or loads, as a whole
  Index joined = 0;            ///< of at least a hundredth of the largest, by faces of voxels, with an earlier one
  Vec<3> joined_at{};          ///< the first voxel of one of these
};

/// What was found on one grid.
struct CellLevel {
  Vec<3> edges;     ///< of a cell [length]
  Index cells = 0;  ///< that are not void
  int iterations = 0;
  double strain_energy = 0.0;    ///< [force * length]
  double support_energy = 0.0;   ///< of elastic supports [force * length]
  double potential = 0.0;        ///< both energies less the work of the loads
  double iteration_error = 0.0;  ///< relative, in the energy norm: what the iterations left
  /// Of the three finest grids: what cells with several materials store too little under their tractions [force *
  /// length]: the compliance of layers that they lack.
  double interface_energy = 0.0;
  /// By part on which something is prescribed: the force and moment by which that holds the body, of elastic supports
  /// that of the springs. Where parts meet each has a like share of what both prescribe; what iterations leave out of
  /// balance goes to the parts that hold its direction, so that reactions balance the loads to rounding.
  Resultants<3> reactions{};
  /// Of the second and third grid: 3 x points, as CellSolution::displacement.
  Points<3> displacement{};
};

/// What was found on the finest grid, and on the coarser ones before it.
struct CellSolution {
  Lattice grid;
  Mat<3> axes = Mat<3>::Identity();  ///< of the image: the grid is turned so about its origin
  Points<3> displacement;  ///< in the world's axes, 3 x points of the grid; continued to points of void next to the
                           ///< body, 0 beyond
  /// Ascending edges: the answer's own grid first. Without grids whose points near the supports do not hold the body.
  std::vector<CellLevel> levels;
  std::vector<AppliedLoad<3>> applied;  ///< the loads, as the finest grid has them
  /// Relative error in the energy norm that the grid leaves, from the potentials of three grids, less
  /// that of interfaces; 1 where no coarser grid holds the body.
  double grid_error = 0.0;
  /// Relative error in the energy norm of cells with several materials: the root of CellLevel::interface_energy over
  /// the strain energy.
  double interface_error = 0.0;
  /// Strain energy extrapolated to cells without size from the last two grids at the rate of the last three, between
  /// between one and two (that of smooth fields and boundaries; re-entrant corners and noise come with less), with the
  /// compliance that interfaces lack.
  double extrapolated_energy = 0.0;

  /// Whether pressures are those of the mean dilatation in each cell, as for nu > 0.4: local ones are not to be used.
  bool mean_dilatation = false;

  /// If asked for: relative change of the strain energy, to first order, if the boundaries of the material were half a
  /// voxel further in.
  double half_voxel = 0.0;

  BodiesOnGrid bodies{};  ///< of the finest grid

  const CellLevel& finest() const { return levels.front(); }
};

/// Trilinear displacements on a grid of equal boxes that the image's frame is cut into, their strains weighted with the
/// stiffness of what the image has in each octant of a cell (finite cells; Parvizian, Duester & Rank 2007). Conjugate
/// gradients preconditioned by geometric multigrid, a Chebyshev polynomial over the diagonal as smoother (Adams,
/// Brezina, Hu & Tuminaro 2003); each coarser grid is solved first and hands its answer up (Brandt 1977).
///
/// `materials` by label, void 0 left out of account; what differs from place to place is taken at the middle of
/// each octant (of more than two voxels a side: at points two voxels apart, and their mean). Anisotropic materials
/// differ by a factor at most; iterations grow as the root of the ratio between their largest and smallest stiffness.
/// Where nu > 0.4 somewhere, pressures are of the mean dilatation of each cell (Malkus & Hughes 1978); iterations grow
/// as the square root of bulk over shear modulus. Conditions and loads are on faces of voxels that bound the material:
/// the sides of the frame, "pores", or CellOptions::parts. Displacements are set at the grid's points within half a
/// cell of a part; springs and tractions act at the faces, with the area of the smooth surface that these are the steps
/// of (surface_area), pressures on the faces themselves. Tractions are taken to be linear in the normal, whose length
/// they may get is not 1. All vectors are in the world's axes, along which the image need not be. Bodies that nothing
/// holds and nothing loads do not count. Bitwise the same on any number of threads; memory: cell_memory.
///
/// Stages: assembly, solve. Throws InputError for a broken image, a size that is not positive, a label without material
/// or with one that is anisotropic and differs from place to place by more than a factor, parts of the boundary that
/// are none or empty, displacements that contradict each other, pressures that follow the body, mass forces without a
/// density for every label (Loads::density, by label), or too little memory, FreeBody for one that is not held;
/// NumericalError if the iterations break down or do not end.
///
/// One solution for each load case, with one hierarchy of grids.
std::vector<CellSolution> solve_cases_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                                               const std::vector<DisplacementCondition<3>>& conditions,
                                               const std::vector<Loads<3>>& cases, const CellOptions& options = {},
                                               const Monitor& monitor = {});
/// Of one case.
CellSolution solve_on_cells(const LabelImage<3>& image, const std::vector<SharedMaterial>& materials,
                            const std::vector<DisplacementCondition<3>>& conditions, const Loads<3>& loads,
                            const CellOptions& options = {}, const Monitor& monitor = {});

/// Displacement at a point of the frame on one of the three finest grids, counted from the finest.
Vec<3> displacement_at(const CellSolution& solution, std::size_t level, const Vec<3>& x);

/// Displacement, strain and stress at the vertices of a mesh of the image, each of one region (cut_regions).
/// Displacements are interpolated; strains are linear fits around the points of the grid to those of the cells,
/// weighted with how much of the region is at them, and interpolated in between. `region_of_label` by label: region of
/// the mesh, -1 where there is none; `materials` by region. Bitwise the same on any number of threads.
Fields<3> recover_fields(const CellSolution& solution, const LabelImage<3>& image, const FineMesh<3>& mesh,
                         const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials);

}  // namespace efree
