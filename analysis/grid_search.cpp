// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/grid_search.hpp"

#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <string>

namespace efree::internal {
namespace {

Estimates estimates_on_cells(const CellSolution& solution) {
  const CellLevel& finest = solution.finest();
  return {.cloud = finest.iteration_error,
          .uncorrected = finest.iteration_error,
          .mesh = std::hypot(solution.grid_error, solution.interface_error),
          .corrections = finest.iterations};
}

}  // namespace

void search_grid(const Settings<3>& settings, const GridProblem& problem, const std::function<void(ImageAnswer&)>& tell,
                 ImageResult& result, const Monitor& monitor) {
  const Stopwatch seconds;
  const bool fixed = problem.size_is_said, asked = settings.asks_for_accuracy();
  const auto tell_all = [&] {
    const Stage stage("output", monitor);
    for (ImageAnswer* answer : result.answers()) tell(*answer);
  };
  std::string why = fixed ? mesh_is_said : "";
  for (double size = problem.size;; size *= 0.5) {
    const double begin = seconds();
    double error = 0.0;
    try {
      auto solutions =
          solve_cases_on_cells(problem.image, problem.materials, settings.supports, problem.cases,
                               {.size = size, .half_voxel = true, .held = true, .parts = problem.parts}, monitor);
      const auto answers = result.answers();
      for (std::size_t k = 0; k < solutions.size(); ++k) {
        ImageAnswer& answer = *answers[k];
        answer.estimates = estimates_on_cells(solutions[k]);
        answer.solution.strain_energy = solutions[k].finest().strain_energy;
        answer.cells = std::move(solutions[k]);
        error = std::max(error, answer.estimates->total());
      }
    } catch (const FreeBody&) {
      // Points of a finer grid may lie on a part that is smaller than cells.
      if (fixed || result.cells || size < 1.99 * problem.image.spacing.minCoeff()) throw;
      continue;
    } catch (const NumericalError& failure) {
      if (!result.cells) throw;
      why = fmt::format("a finer grid fails: {}", failure.what());
      break;
    }
    const CellLevel& finest = result.cells->finest();
    const double spent = seconds() - begin;
    if (!settings.goals.empty()) tell_all();
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
  if (settings.goals.empty()) tell_all();
}

}  // namespace efree::internal
