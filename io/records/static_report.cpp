// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/static_report.hpp"

#include "efree/io/records/internal/utilisation_records.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <cmath>

namespace efree {
namespace {

template <int Dim> std::string estimates_text(const Result<Dim>& result) {
  const Estimates& estimates = *result.estimates;
  if (result.cells)
    return fmt::format(
        "{} cells, {} iterations; error in the energy norm: about {:.2g} %; strain energy {:.6g}, extrapolated {:.6g}; "
        "half a voxel changes it by {:.2g} %",
        result.cells->finest().cells, estimates.corrections, 100.0 * estimates.total(), result.solution.strain_energy,
        result.cells->extrapolated_energy, 100.0 * result.cells->half_voxel);
  const std::string of_facets =
      estimates.geometry > 0.0 ? fmt::format(", {:.2g} % of the facets of the boundary", 100.0 * estimates.geometry)
                               : "";
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
  return fmt::format(
      "error of the path, by one of {:.2g} times the spacing: about {:.2g} % of the work, at most {:.2g} % ({}); of "
      "the stresses at the end {}",
      errors.coarser, 100.0 * errors.work, 100.0 * most, of,
      errors.stress ? fmt::format("{:.2g} %", 100.0 * *errors.stress) : "unknown");
}

/// The components with those that are rounding, measured by `scale`, as 0.
template <class Values> Values rounded(Values values, double scale) {
  for (double& value : values)
    if (std::abs(value) <= 1e-10 * scale) value = 0.0;
  return values;
}
template <int Dim> std::string resultant_text(const Resultant<Dim>& of, const Resultant<Dim>& scale) {
  return fmt::format("force ({:.6g}), moment ({:.6g})", fmt::join(rounded(of.force, scale.force.norm()), ", "),
                     fmt::join(rounded(of.moment, scale.moment.norm()), ", "));
}

/// Probes, loads, reactions and extremes, with their errors where they are known, a line each.
template <int Dim> std::vector<std::string> numbers_text(const Result<Dim>& result, const Settings<Dim>& settings) {
  const auto& cases = settings.cases;
  std::vector<std::string> lines;
  const auto say = [&](const std::string& what, const Vec<Dim>& value, const Vec<Dim>* error) {
    lines.push_back(fmt::format("{} ({:.6g})", what, fmt::join(value, ", ")));
    if (error)
      lines.back() +=
          fmt::format(" +- ({:.2g}), {:.2g} %", fmt::join(*error, ", "), 100.0 * relative_error<Dim>(value, *error));
  };
  const auto say_wanted = [&](const Answer<Dim>& answer) {
    for (const auto& [name, values] : answer.probes) {
      const auto error = answer.probe_errors.find(name);
      say(fmt::format("probe \"{}\": displacement", name), values.displacement,
          error == answer.probe_errors.end() ? nullptr : &error->second);
    }
    for (const auto& reaction : answer.reactions)
      say(fmt::format("reaction \"{}\": force", reaction.name), reaction.force, &reaction.error);
  };
  const auto say_utilisations = [&](const Fields<Dim>& fields) {
    for (const auto& one : largest_utilisations(settings.common, result.basis().space, fields))
      lines.push_back(internal::utilisation_text(one));
  };
  const auto say_balance = [&](const auto& balance) {
    Resultant<Dim> scale;
    const auto add = [&](const Resultant<Dim>& of) { scale += {of.force.cwiseAbs(), of.moment.cwiseAbs()}; };
    for (const auto& load : balance.loads) add(load.of);
    for (const auto& [part, of] : balance.reactions) add(of);
    for (const auto& load : balance.loads)
      lines.push_back(fmt::format("load {}{}: {}", load.kind, load.on.empty() ? "" : fmt::format(" on \"{}\"", load.on),
                                  resultant_text<Dim>(load.of, scale)));
    for (const auto& [part, of] : balance.reactions)
      lines.push_back(fmt::format("reaction of \"{}\": {}", part, resultant_text<Dim>(of, scale)));
    lines.push_back(fmt::format("loads and reactions balance to {:.1g}, relative", balance.error));
  };
  const auto say_extremes = [&](const std::vector<Extreme<Dim>>& extremes) {
    for (const auto& extreme : extremes)
      lines.push_back(fmt::format(
          "largest {} {:.6g} at ({:.6g}){}", extreme.of == "displacement" ? "displacement" : "von Mises stress",
          extreme.value, fmt::join(extreme.at, ", "), extreme.error ? fmt::format(" +- {:.2g}", *extreme.error) : ""));
  };
  if (!cases.empty()) lines.push_back(fmt::format("case \"{}\":", cases.front().name));
  say_wanted(result);
  if (!result.history.empty())  // without errors
    for (const auto& reaction : settings.reactions)
      say(fmt::format("reaction \"{}\": force", reaction.name), result.balance.reactions.at(reaction.on).force,
          nullptr);
  say_balance(result.balance);
  say_extremes(result.extremes);
  say_utilisations(result.fields);
  for (std::size_t k = 1; k < cases.size(); ++k) {
    const Answer<Dim>& answer = result.more[k - 1];
    lines.push_back(fmt::format("case \"{}\":", cases[k].name));
    say_wanted(answer);
    say_balance(answer.balance);
    say_extremes(answer.extremes);
    say_utilisations(answer.fields);
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
