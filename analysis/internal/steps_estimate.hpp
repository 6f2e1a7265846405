// SPDX-License-Identifier: GPL-3.0-or-later
/// What steps through time lead to, and how far those of a cloud are from the finite elements of its fine mesh.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/algorithms/elements_beside.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Strains and stresses where they live, from the `points` of a state.
template <int Dim>
Solution<Dim> solution_of(const NonlinearEquilibrium<Dim>& equations, const State& state, PointFields<Dim>& points) {
  const auto& approximation = equations.approximation();
  return {state.u.reshaped(Dim, approximation.shape.num_nodes()), std::move(points.strain), std::move(points.stress),
          approximation.quadrature.weights.dot(points.energy)};
}

/// Puts the error of a cloud's last state into the result, which has its fields and history, and, of bodies whose
/// answer is to be corrected, the state of the elements in its place. Why the error is not known; nothing where it is.
template <int Dim> std::string estimate_steps(const Settings<Dim>& settings, Program<Dim> program, const State& last,
                                              Result<Dim>& result, const Monitor& monitor);

/// Where the load of a path by arc length, proportional to the time, stays as it is for good.
struct Plateau {
  std::size_t begin;  ///< the step at which half of the work was done
  double rise;        ///< of the load since then, relative
};
/// Stiffness against the load, relative to that at the beginning, on a plateau.
inline constexpr double plateau_stiffness = 1e-3;
/// That at the end of a history: since half of the work was done the stiffness has been less than plateau_stiffness, by
/// the range of the load and the work done there against those of the first step, and the load is within 0.5 % of the
/// largest. A load that tends to its limit as the inverse of the displacement lacks as much as it has risen.
template <int Dim> std::optional<Plateau> plateau_of(const std::vector<HistoryStep<Dim>>& history) {
  constexpr double most_rise = 5e-3;
  const auto work = [](const HistoryStep<Dim>& step) { return step.stored + step.dissipated; };
  const HistoryStep<Dim>&first = history.front(), &last = history.back();
  double low = last.time, high = last.time;
  for (std::size_t k = history.size(); k-- > 0;) {
    const HistoryStep<Dim>& step = history[k];
    low = std::min(low, step.time);
    high = std::max(high, step.time);
    if (work(step) > 0.5 * work(last)) continue;
    const double compliance = 2.0 * work(first) / (first.time * first.time),
                 most = std::max(std::abs(low), std::abs(high));
    const bool is_plateau = compliance > 0.0 && high - low <= most_rise * most &&
                            compliance * most * (high - low) < plateau_stiffness * (work(last) - work(step));
    return is_plateau ? std::optional(Plateau{k, (high - low) / most}) : std::nullopt;
  }
  return std::nullopt;
}

/// Puts the errors of the path, by Steps::coarser and, unless it is null, a path that is coarser still, or by a coarser
/// cloud, which is solved, into the result. Why they are unknown; nothing where they are known.
template <int Dim> std::string estimate_path(const Settings<Dim>& settings, const Result<Dim>* coarsest,
                                             Result<Dim>& result, const Monitor& monitor);

/// Adds errors by the size of its steps to those of a path by its `coarser` one and, unless it is null, the coarsest.
/// Where materials flow they fall with the first power of the steps, as what they remember is integrated by backward
/// Euler (Simo & Hughes 1998, section 3.3): the coarsest path that flows as the result does is solved again with twice
/// as many steps. A warning where that fails, or none flows.
template <int Dim> void add_errors_of_steps(const Settings<Dim>& settings, const Result<Dim>& coarser,
                                            const Result<Dim>* coarsest, Result<Dim>& result, const Monitor& monitor);
/// A warning, and Result::elastic_range, where loads leave the straight line between two steps of a path of materials
/// that flow: neither the path nor estimates of its errors see what they do there.
template <int Dim> void check_turning_loads(const Settings<Dim>& settings, Result<Dim>& result);
/// Warnings of a path to this end besides those of its errors: where it becomes unstable, and what its functions and
/// its model cannot represent. Result::gap, the distance of held boundaries from what is prescribed.
template <int Dim> void warn_of_path(const Settings<Dim>& settings, const NonlinearEquilibrium<Dim>& equations,
                                     const State& end, Result<Dim>& result);
/// Times at which steps are to end, ascending: these stops; where what acts on a body that flows has extremes or kinks,
/// as a step that passes over one misses what the body dissipates up to it; before and after jumps; and, where the
/// settings leave steps open, so that loads hardly leave the straight line between them (LoadCurve).
template <int Dim>
std::vector<double> stops_at_turns(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, std::vector<double> stops);

/// How much smaller the steps of a path are to be, and why, in words.
struct SmallerSteps {
  double factor;         ///< of PathOptions::scale
  double elastic_range;  ///< TimeSettings::elastic_range
  std::string why;
};
/// For a path whose settings, with defaults, leave its steps open, where its errors are large and by the size of steps,
/// or loads turn within these.
template <int Dim>
std::optional<SmallerSteps> smaller_steps_for(const Settings<Dim>& settings, const Result<Dim>& result);
/// Settings of a path that goes on from a checkpoint: its steps are left open as they were there.
template <int Dim> Settings<Dim> with_steps_of_checkpoint(Settings<Dim> settings);
/// Settings of the path of a result with smaller steps, from the beginning on.
template <int Dim> Settings<Dim> with_smaller_steps(Settings<Dim> settings, const Result<Dim>& result,
                                                    const SmallerSteps& smaller, const Monitor& monitor);

}  // namespace efree::internal
