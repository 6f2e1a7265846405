// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/judge.hpp"

#include "efree/analysis/internal/told_errors.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

/// Relative error in the energy norm from which on an answer is doubtful: one per cent of the energy.
constexpr double doubtful = 0.1;

/// The warning that an accuracy is not reached.
template <int Dim> std::string not_reached(const Settings<Dim>& settings, double error, const std::string& why) {
  return fmt::format("an error of {:.2g} % in the energy norm was asked for, {:.2g} % is reached: {}",
                     100.0 * settings.accuracy, 100.0 * error, why);
}

}  // namespace

template <int Dim>
std::vector<std::string> doubts(const ApproximationOptions& options, const Approximation<Dim>& approximation) {
  if (options.kind != BasisKind::mls || options.secondary == SecondaryKind::full) return {};
  const double reached = approximation.ratio();
  const double asked = options.ratio > 0.0 ? options.ratio : std::numeric_limits<double>::infinity();
  if (asked >= 1.4 && reached >= 1.0) return {};
  return {fmt::format(
      "M/N = {:.2g}: under 1.4 the quadrature sees too little of the deformation; results may be far too soft",
      std::min(asked, reached))};
}

template <int Dim> double bearable_error(const Settings<Dim>& settings) {
  return settings.accuracy > 0.0 ? settings.accuracy : doubtful;
}

template <int Dim>
std::vector<std::string> misses(const Settings<Dim>& settings, const std::string& why, const Answer<Dim>& answer) {
  std::vector<std::string> all;
  if (settings.accuracy > 0.0 && answer.estimates->total() > settings.accuracy)
    all.push_back(not_reached(settings, answer.estimates->total(), why));
  for (const auto& goal : settings.goals) {
    const double error = relative_error_of<Dim>(goal, answer);
    if (error <= goal.error) continue;
    all.push_back(fmt::format("an error of {:.2g} % of the {} \"{}\" was asked for, {:.2g} % is reached: {}",
                              100.0 * goal.error, goal.of == Goal::Of::probe ? "probe" : "reaction", goal.name,
                              100.0 * error, why));
  }
  return all;
}

template <int Dim> void warn_of_misses(const Settings<Dim>& settings, const std::string& why, Result<Dim>& result) {
  for (std::string& miss : misses<Dim>(settings, why, result)) result.warnings.push_back(std::move(miss));
}

template <int Dim> double aim(const Settings<Dim>& settings) {
  return settings.accuracy > 0.0 ? 0.75 * settings.accuracy : doubtful;
}

template <int Dim> double tolerance_of(const Settings<Dim>& settings) {
  double tolerance = 0.3 * aim(settings);
  for (const auto& goal : settings.goals) tolerance = std::min(tolerance, goal.error);
  return tolerance;
}

template <int Dim> double excess(const Settings<Dim>& settings, const Result<Dim>& result) {
  const double energy = settings.accuracy > 0.0 ? result.estimates->total() / aim(settings) : 0.0;
  return std::max(energy, missed_goals<Dim>(settings, result));
}

/// What else helps where elements are linear.
template <int Dim> const char* or_quadratic(const Settings<Dim>& settings, const Result<Dim>& result) {
  if (result.basis().space.degree() == 2) return "";
  return settings.common.approximation.kind == BasisKind::p1 ? ", or quadratic elements (basis.kind = \"p2\")"
                                                             : ", or quadratic cells (basis.interpolation = 2)";
}

/// Of the load cases after the first: they have its mesh and its matrix, but not its error.
template <int Dim> void judge_more(const Settings<Dim>& settings, Result<Dim>& result) {
  for (std::size_t k = 0; k < result.more.size(); ++k) {
    if (!result.more[k].estimates) continue;
    const double error = result.more[k].estimates->total();
    if (error < std::min(bearable_error(settings), settings.largest_error)) continue;
    const std::string what =
        fmt::format("the case \"{}\" has an error of about {:.2g} % in the energy norm: use a smaller mesh_size{}",
                    settings.cases[k + 1].name, 100.0 * error, or_quadratic(settings, result));
    if (error < settings.largest_error)
      result.warnings.push_back(what);
    else if (result.refusal.empty())
      result.refusal = fmt::format("{}; to accept it say analysis.largest_error = {:.2g}", what, 1.1 * error);
  }
}

/// Of a load path by its comparison with a coarser one: stresses, whose error is one of the energy norm, and values.
template <int Dim> void judge_path(const Settings<Dim>& settings, Result<Dim>& result) {
  if (!result.path_errors) return;
  const PathErrors& errors = *result.path_errors;
  const auto [most, of] = errors.largest();
  const char* advice = settings.common.approximation.kind == BasisKind::mls ? "use a smaller spacing of the cloud"
                                                                            : "use a smaller mesh_size";
  if (2.0 * errors.steps > most)
    advice = "most of it is by the size of the steps, use smaller ones ([time] step and max_step)";
  const auto judge_one = [&](const std::string& what, double error, double bearable) {
    if (error < std::min(bearable, settings.largest_error)) return;
    const std::string text =
        fmt::format("{} may be {:.2g} % off, judged by a coarser path: {}", what, 100.0 * error, advice);
    if (error < settings.largest_error || !result.refusal.empty())
      result.warnings.push_back(text);
    else
      result.refusal = fmt::format("{}; to accept it say analysis.largest_error = {:.2g}", text,
                                   1.1 * std::max(most, errors.stress.value_or(0.0)));
  };
  judge_one(of, most, bearable_error_of_path);
  if (errors.stress) judge_one("the stresses", *errors.stress, bearable_error(settings));
  if (errors.until < result.history.back().time)
    result.warnings.push_back(
        fmt::format("displacements, forces and stresses beyond time {:.6g} may be off by any amount: the coarser path "
                    "does not come further, and their errors are not estimated",
                    errors.until));
}

/// Warns of an error in the energy norm, or refuses an answer with it.
template <int Dim> void judge_error(const Settings<Dim>& settings, double error, const std::string& what,
                                    const std::string& of, std::vector<std::string>& warnings, std::string& refusal) {
  const std::string text = fmt::format("{}in the energy norm {}", of, what);
  if (error < settings.largest_error || !refusal.empty())
    warnings.push_back(text);
  else
    refusal = fmt::format("{}; to accept it say analysis.largest_error = {:.2g}", text, 1.1 * error);
}

void judge_grid(const Settings<3>& settings, const Estimates& errors, const std::string& of,
                std::vector<std::string>& warnings, std::string& refusal) {
  const double bearable = settings.accuracy > 0.0 ? settings.accuracy : bearable_error_of_grid;
  if (errors.total() <= std::min(bearable, settings.largest_error)) return;
  judge_error(settings, errors.total(),
              fmt::format("the grid leaves an error of about {:.2g} %: use a smaller mesh_size", 100.0 * errors.mesh),
              of, warnings, refusal);
}

template <int Dim> void judge(const Settings<Dim>& settings, Result<Dim>& result) {
  judge_more(settings, result);
  judge_path(settings, result);
  if (!result.estimates || !result.refusal.empty()) return;
  const Estimates& errors = *result.estimates;
  if (errors.total() < std::min(bearable_error(settings), settings.largest_error)) return;
  const std::string what =
      errors.geometry > std::max(errors.mesh, errors.cloud)
          ? fmt::format("the facets of the boundary leave an error of about {:.2g} %: use a smaller mesh_size",
                        100.0 * errors.geometry)
      : errors.cloud > errors.mesh
          ? fmt::format(
                "the answer is {:.2g} % off that of the finite elements of its mesh: correct it "
                "(analysis.correction = \"auto\"), or use a smaller spacing",
                100.0 * errors.cloud)
          : fmt::format("the fine mesh leaves an error of about {:.2g} %: use a smaller mesh_size{}",
                        100.0 * errors.mesh, or_quadratic(settings, result));
  judge_error(settings, errors.total(), what, "", result.warnings, result.refusal);
}

template std::vector<std::string> doubts<2>(const ApproximationOptions&, const Approximation<2>&);
template double bearable_error<2>(const Settings<2>&);
template std::vector<std::string> misses<3>(const Settings<3>&, const std::string&, const Answer<3>&);
template void warn_of_misses<2>(const Settings<2>&, const std::string&, Result<2>&);
template double aim<2>(const Settings<2>&);
template double tolerance_of<2>(const Settings<2>&);
template double excess<2>(const Settings<2>&, const Result<2>&);
template void judge<2>(const Settings<2>&, Result<2>&);
template std::vector<std::string> doubts<3>(const ApproximationOptions&, const Approximation<3>&);
template double bearable_error<3>(const Settings<3>&);
template void warn_of_misses<3>(const Settings<3>&, const std::string&, Result<3>&);
template double aim<3>(const Settings<3>&);
template double tolerance_of<3>(const Settings<3>&);
template double excess<3>(const Settings<3>&, const Result<3>&);
template void judge<3>(const Settings<3>&, Result<3>&);

}  // namespace efree::internal
