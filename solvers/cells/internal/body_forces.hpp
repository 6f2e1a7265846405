// SPDX-License-Identifier: GPL-3.0-or-later
/// Forces in the body on grids of cells: by volume, or by mass.
#pragma once

#include "efree/geometry/input/box_averages.hpp"
#include "efree/solvers/cells/internal/cell_problem.hpp"

#include <functional>
#include <string>
#include <vector>

namespace efree::internal {

/// How much a grid's octants have of something that each label has its part of, layer by layer: on the finest grid as
/// it is asked for, as all of it would take more memory than the solution.
class OctantShare {
 public:
  /// Of a grid of so many cells over the image; `value_of_label`: how much a whole octant has.
  OctantShare(const LabelImage<3>& image, const std::vector<float>& value_of_label, const std::array<Index, 3>& cells);
  /// Of the layers [begin, end) of cells (PartOrder).
  std::vector<float> layers(Index begin, Index end) const;
  /// Goes on to a grid with fewer cells, by `ratio` along each axis, 1 or 2.
  void coarsen(const std::array<int, 3>& ratio);

 private:
  BoxAverages of_image_;
  std::array<Index, 3> cells_;
  bool is_finest_ = true;
  std::vector<float> parts_;  ///< of coarser grids
};

/// Those of all load cases.
class BodyForces {
 public:
  /// On the finest grid. Densities by label (Loads::density). Throws InputError for a mass force without one. Keeps
  /// references to the cases.
  BodyForces(const LabelImage<3>& image, const std::vector<Loads<3>>& cases, const std::array<Index, 3>& cells);
  /// Goes on to the next grid.
  void coarsen(const std::array<int, 3>& ratio);
  /// Adds the forces of a case at the centres of octants, unscaled. Returns what each load is. Throws InputError for
  /// forces that are not finite. Bitwise the same on any number of threads.
  std::vector<AppliedLoad<3>> add(const CellProblem& problem, std::size_t load_case, Field& to) const;

 private:
  struct Term {
    std::size_t share;
    std::function<Vec<3>(const Vec<3>& x)> force;  ///< for each unit of what is shared
  };
  struct Load {
    std::string kind;
    std::vector<Term> terms;
  };
  /// The number of a share, which may be there already.
  std::size_t share_of(const LabelImage<3>& image, const std::vector<float>& values, const std::array<Index, 3>& cells);
  Load mass_force(const LabelImage<3>& image, const MassForce<3>& load, const std::vector<Parameter>& density,
                  const std::array<Index, 3>& cells);

  std::vector<std::vector<float>> values_;  ///< by share
  std::vector<OctantShare> shares_;
  std::vector<std::vector<Load>> loads_;  ///< by case
};

}  // namespace efree::internal
