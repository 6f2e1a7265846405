// SPDX-License-Identifier: GPL-3.0-or-later
/// Fields of a solution on cells, cell by cell.
#pragma once

#include "efree/solvers/algorithms/static_analysis.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <cstdint>
#include <limits>
#include <vector>

namespace efree {

/// Voxels by which a point may miss the material that it is meant to be in: as far as faces of voxels are from the
/// surface that they stand for.
inline constexpr int probe_reach = 1;

/// The largest and the smallest value of something, and where they are; infinite, the wrong way round, where there was
/// none.
struct PlacedRange {
  double most = -std::numeric_limits<double>::infinity(), least = std::numeric_limits<double>::infinity();
  Vec<3> most_at = Vec<3>::Zero(), least_at = Vec<3>::Zero();

  void add(double value, const Vec<3>& at) {
    if (value > most) most = value, most_at = at;
    if (value < least) least = value, least_at = at;
  }
  /// Of what comes later: of like values the first stays.
  void add(const PlacedRange& later) {
    if (later.most > most) most = later.most, most_at = later.most_at;
    if (later.least < least) least = later.least, least_at = later.least_at;
  }
};

/// What recovered stresses of a region reach.
struct RegionStresses {
  PlacedRange von_mises, first, third;  ///< von Mises stress, first and third principal stress [stress]
  double volume = 0.0;                  ///< of its material in the cells [length^3]
};

/// In single precision, cells with x fastest, as in the grid of the solution; tensors in the world's axes.
struct CellFields {
  std::vector<float> solid;                                ///< part of the cell that has material
  std::vector<std::int16_t> region;                        ///< that most of the material is of; -1: the cell is void
  Eigen::Matrix<float, 6, Eigen::Dynamic> strain, stress;  ///< means over the material; 0 in void
  std::vector<float> von_mises;                            ///< likewise
  /// Displacement (3) at the corners of cells whose octant there is at least half material; strain (6) and stress (6)
  /// by component, and the largest principal stress above the smallest one, at the centres of whole cells, and of such
  /// octants of others.
  std::vector<PlacedRange> ranges;
  PlacedRange displacement;             ///< its length there
  std::vector<RegionStresses> regions;  ///< by region
  std::vector<ProbeValues<3>> probes;   ///< at the points that were asked for
};

/// Recovers strains and stresses: linear fits around the points of the grid to the strains in the octants of the cells,
/// weighted with how much of a region is in them, interpolated to the octants' centres. `region_of_label` by label:
/// region, -1 where there is none; `materials` by region, `probes` points in the world. Bitwise the same on any number
/// of threads.
CellFields recover_cell_fields(const CellSolution& solution, const LabelImage<3>& image,
                               const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials,
                               const std::vector<Vec<3>>& probes = {});

/// The largest von Mises stress that recover_cell_fields finds on the second or third grid (`level` 1 or 2).
double largest_von_mises(const CellSolution& solution, std::size_t level, const LabelImage<3>& image,
                         const std::vector<Index>& region_of_label, const std::vector<SharedMaterial>& materials);

}  // namespace efree
