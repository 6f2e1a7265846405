// SPDX-License-Identifier: GPL-3.0-or-later
/// Grids of cells for an image, finer and finer until the error is bearable.
#pragma once

#include "efree/analysis/image_analysis.hpp"

#include <functional>
#include <vector>

namespace efree::internal {

/// An image with its materials, and how its grids begin.
struct GridProblem {
  const LabelImage<3>& image;
  std::vector<SharedMaterial> materials;  ///< by label
  VoxelParts parts;                       ///< CellOptions::parts
  std::vector<Loads<3>> cases;            ///< each with its densities by label
  double size;                            ///< edges of the first grid's cells [length]
  bool size_is_said;                      ///< and no other may be taken
};

/// Solves the cases; sets cells, energies and estimates of the answers, and attempts and warnings of the result, whose
/// answers are as many as there are cases. Calls tell(answer) for every answer whenever probes, reactions and extremes
/// have to be known. Where nobody said how fine the grid is, grids of half the edges follow until bodies are held and
/// the error is bearable: down to the voxels, to half of them if the answer were refused else, or as far as an accuracy
/// that is asked for takes it. Throws as solve_on_cells.
void search_grid(const Settings<3>& settings, const GridProblem& problem, const std::function<void(ImageAnswer&)>& tell,
                 ImageResult& result, const Monitor& monitor);

}  // namespace efree::internal
