// SPDX-License-Identifier: GPL-3.0-or-later
/// Answers in words, of whatever analysis.
#pragma once

#include "efree/io/records/internal/utilisation_records.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <cmath>
#include <string>
#include <vector>

namespace efree::internal {

/// Error and energy on cells.
inline std::string grid_text(const CellSolution& cells, const Estimates& estimates) {
  return fmt::format(
      "{} cells, {} iterations; error in the energy norm: about {:.2g} %{}; strain energy {:.6g}, extrapolated {:.6g}; "
      "half a voxel changes it by {:.2g} %",
      cells.finest().cells, estimates.corrections, 100.0 * estimates.total(),
      cells.interface_error > 0.01
          ? fmt::format(", {:.2g} % by cells with several materials", 100.0 * cells.interface_error)
          : "",
      cells.finest().strain_energy, cells.extrapolated_energy, 100.0 * cells.half_voxel);
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

/// What something is, with its error unless that is null.
template <int Dim> std::string vector_text(const std::string& what, const Vec<Dim>& value, const Vec<Dim>* error) {
  std::string line = fmt::format("{} ({:.6g})", what, fmt::join(value, ", "));
  if (error)
    line += fmt::format(" +- ({:.2g}), {:.2g} %", fmt::join(*error, ", "), 100.0 * relative_error<Dim>(value, *error));
  return line;
}

/// Loads and reactions, a line each, and whether they balance.
template <int Dim> std::vector<std::string> balance_text(const Balance<Dim>& balance) {
  std::vector<std::string> lines;
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
  return lines;
}

/// The same with the true surface of the body in place of facets, with its error; nothing where that is not known.
template <int Dim> std::string on_surface_text(const Answer<Dim>& answer,
                                               std::map<std::string, WithError<Vec<Dim>>> OnSurface<Dim>::*kind,
                                               const std::string& name) {
  if (!answer.on_surface) return "";
  const auto& all = (*answer.on_surface).*kind;
  const auto found = all.find(name);
  return found == all.end() ? "" : vector_text<Dim>("; on the true surface", found->second.value, &found->second.error);
}

/// Probes, loads, reactions, extremes and utilisations, with their errors where they are known, a line each.
template <int Dim>
std::vector<std::string> answer_text(const Answer<Dim>& answer, const std::vector<Utilisation<Dim>>& utilisations) {
  std::vector<std::string> lines;
  for (const auto& [name, values] : answer.probes) {
    const auto error = answer.probe_errors.find(name);
    lines.push_back(vector_text<Dim>(fmt::format("probe \"{}\": displacement", name), values.displacement,
                                     error == answer.probe_errors.end() ? nullptr : &error->second) +
                    on_surface_text(answer, &OnSurface<Dim>::probes, name));
  }
  for (const auto& reaction : answer.reactions)
    lines.push_back(
        vector_text<Dim>(fmt::format("reaction \"{}\": force", reaction.name), reaction.force, &reaction.error) +
        on_surface_text(answer, &OnSurface<Dim>::reactions, reaction.name));
  for (std::string& line : balance_text<Dim>(answer.balance)) lines.push_back(std::move(line));
  for (const auto& extreme : answer.extremes)
    lines.push_back(fmt::format(
        "largest {} {:.6g} at ({:.6g}){}", extreme.of == "displacement" ? "displacement" : "von Mises stress",
        extreme.value, fmt::join(extreme.at, ", "), extreme.error ? fmt::format(" +- {:.2g}", *extreme.error) : ""));
  for (const auto& one : utilisations) lines.push_back(utilisation_text(one));
  return lines;
}

}  // namespace efree::internal
