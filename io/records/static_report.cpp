// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/static_report.hpp"

#include "efree/io/records/internal/answer_text.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <cmath>

namespace efree {
namespace {

template <int Dim> std::string estimates_text(const Result<Dim>& result) {
  const Estimates& estimates = *result.estimates;
  std::string of_facets;
  if (estimates.geometry > 0.0)
    of_facets = fmt::format(", {:.2g} % of the facets of the boundary", 100.0 * estimates.geometry);
  if (result.on_surface && result.on_surface->strain_energy) {
    const auto& [energy, error] = *result.on_surface->strain_energy;
    of_facets += fmt::format(" (strain energy {:.6g}, on the true surface {:.6g} +- {:.2g} %)",
                             result.solution.strain_energy, energy, 100.0 * error / energy);
  }
  if (estimates.cloud == 0.0 && estimates.uncorrected == 0.0)  // finite elements that are solved at once
    return fmt::format("error in the energy norm: about {:.2g} %{}", 100.0 * estimates.mesh, of_facets);
  const bool has_cloud = result.elements || result.approximation.shape.num_nodes() < result.approximation.space.size();
  const std::string of_cloud = fmt::format("error in the energy norm: {:.2g} % of {}", 100.0 * estimates.uncorrected,
                                           has_cloud ? "the cloud" : "linear elements");
  const std::string corrected = estimates.corrections == 0
                                    ? ""
                                    : fmt::format(", {:.2g} % after {} correction{}", 100.0 * estimates.cloud,
                                                  estimates.corrections, estimates.corrections == 1 ? "" : "s");
  return fmt::format("{}{}; about {:.2g} % of the fine mesh{}", of_cloud, corrected, 100.0 * estimates.mesh, of_facets);
}

std::string path_errors_text(const PathErrors& errors) {
  const auto [most, of] = errors.largest();
  const std::string of_dissipated =
      errors.dissipated > 0.0 ? fmt::format(" ({:.2g} % of what is dissipated)", 100.0 * errors.dissipated) : "";
  const std::string by_steps =
      errors.steps > 0.0 ? fmt::format(", up to {:.2g} % of it by the size of the steps", 100.0 * errors.steps) : "";
  return fmt::format(
      "error of the path, by one of {:.2g} times the spacing{}: about {:.2g} % of the work{}, at most {:.2g} % ({}){}; "
      "of the stresses at the end {}",
      errors.coarser, errors.steps > 0.0 ? " and smaller steps" : "", 100.0 * errors.work, of_dissipated, 100.0 * most,
      of, by_steps, errors.stress ? fmt::format("{:.2g} %", 100.0 * *errors.stress) : "unknown");
}

/// Probes, loads, reactions and extremes, with their errors where they are known, a line each.
template <int Dim> std::vector<std::string> numbers_text(const Result<Dim>& result, const Settings<Dim>& settings) {
  const auto& cases = settings.cases;
  std::vector<std::string> lines;
  const auto say = [&](const Answer<Dim>& answer) {
    if (&answer == &result && !result.history.empty())  // without errors
      for (const auto& reaction : settings.reactions)
        lines.push_back(internal::vector_text<Dim>(fmt::format("reaction \"{}\": force", reaction.name),
                                                   result.balance.reactions.at(reaction.on).force, nullptr));
    const auto utilisations = largest_utilisations(settings.common, result.basis().space, answer.fields);
    for (std::string& line : internal::answer_text<Dim>(answer, utilisations)) lines.push_back(std::move(line));
  };
  if (!cases.empty()) lines.push_back(fmt::format("case \"{}\":", cases.front().name));
  say(result);
  for (std::size_t k = 1; k < cases.size(); ++k) {
    lines.push_back(fmt::format("case \"{}\":", cases[k].name));
    say(result.more[k - 1]);
  }
  return lines;
}

}  // namespace

template <int Dim> std::vector<std::string> describe_result(const Settings<Dim>& settings, const Result<Dim>& result) {
  std::vector<std::string> lines;
  if (result.estimates) lines.push_back(estimates_text(result));
  if (result.path_errors) lines.push_back(path_errors_text(*result.path_errors));
  for (std::string& line : numbers_text<Dim>(result, settings)) lines.push_back(std::move(line));
  return lines;
}

template std::vector<std::string> describe_result(const Settings<2>&, const Result<2>&);
template std::vector<std::string> describe_result(const Settings<3>&, const Result<3>&);

}  // namespace efree
