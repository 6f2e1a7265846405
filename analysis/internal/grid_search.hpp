// SPDX-License-Identifier: GPL-3.0-or-later
/// Grids of cells for an image, finer and finer until the error is bearable.
#pragma once

#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <string>
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

/// Relative error in the energy norm from which on a finer grid follows by itself: 2 % of the energy. Cells of two
/// voxels leave 10 to 13 % where there are pores, and energies that are extrapolated within half a per cent.
inline constexpr double bearable_error_of_grid = 0.14;

inline Estimates estimates_on_cells(const CellSolution& solution) {
  const CellLevel& finest = solution.finest();
  return {.cloud = finest.iteration_error,
          .uncorrected = finest.iteration_error,
          .mesh = std::hypot(solution.grid_error, solution.interface_error),
          .corrections = finest.iterations};
}

/// Solves the cases, calls take(solutions), which sets the answers' energies and estimates (estimates_on_cells), and
/// `tell` whenever probes, reactions and extremes have to be known; sets attempts and warnings of the result, which is
/// the answer to the first case. Where nobody said how fine the grid is, grids of half the edges follow until the
/// error is bearable: down to the voxels, to half of them if the answer were refused else, or as far as an accuracy
/// that is asked for takes it. Throws as solve_on_cells.
template <class Found, class Take, class Tell> void search_grid(const Settings<3>& settings, const GridProblem& problem,
                                                                const Take& take, const Tell& tell, Found& result,
                                                                const Monitor& monitor) {
  const Stopwatch seconds;
  const bool fixed = problem.size_is_said, asked = settings.asks_for_accuracy();
  std::string why = fixed ? mesh_is_said : "";
  for (double size = problem.size;; size *= 0.5) {
    const double begin = seconds();
    double error = 0.0;
    try {
      auto solutions =
          solve_cases_on_cells(problem.image, problem.materials, settings.supports, problem.cases,
                               {.size = size, .half_voxel = true, .held = true, .parts = problem.parts}, monitor);
      for (const CellSolution& solution : solutions) error = std::max(error, estimates_on_cells(solution).total());
      take(std::move(solutions));
    } catch (const NumericalError& failure) {
      if (!result.cells) throw;
      why = fmt::format("a finer grid fails: {}", failure.what());
      break;
    }
    const CellLevel& finest = result.cells->finest();
    const double spent = seconds() - begin;
    if (!settings.goals.empty()) tell();
    const double missed = missed_goals<3>(settings, result);
    result.attempts.push_back({size, finest.cells, 1, error, spent,
                               std::max(missed, settings.accuracy > 0.0 ? error / settings.accuracy : 0.0)});
    if (error <= (settings.accuracy > 0.0 ? settings.accuracy : bearable_error_of_grid) && missed <= 1.0) {
      why.clear();
      break;
    }
    // Below its voxels an image says no more: only an answer that would be none is worth the time.
    const double least = (error < settings.largest_error ? 1.0 : 0.5) * problem.image.spacing.minCoeff();
    if (fixed || (!asked && size < 1.99 * least)) break;
    double points = 8.0;
    for (const Index n : result.cells->grid.cubes) points *= n + 1.0;
    if (cell_memory * points > 0.5 * available_memory()) {
      why = "a finer grid would take more memory than there is";
      break;
    }
    if (seconds() + 9.0 * spent > settings.time_limit) {
      why = fmt::format("a finer grid would take about {:.3g} s, and the time limit is {:.3g} s", 9.0 * spent,
                        settings.time_limit);
      break;
    }
  }
  if (asked && !why.empty())
    for (std::string& miss : misses<3>(settings, why, result)) result.warnings.push_back(std::move(miss));
  if (settings.goals.empty()) tell();
}

}  // namespace efree::internal
