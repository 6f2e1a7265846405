// SPDX-License-Identifier: GPL-3.0-or-later
/// Answers as JSON, of whatever analysis.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/io/records/internal/json_array.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace efree::internal {

template <int Dim> nlohmann::ordered_json json_of(const Resultant<Dim>& of) {
  nlohmann::ordered_json json = {{"force", json_array(of.force)}};
  if constexpr (Dim == 2)
    json["moment"] = of.moment[0];
  else
    json["moment"] = json_array(of.moment);
  return json;
}

/// The sums of loads and reactions, and what is left of both together.
template <int Dim> nlohmann::ordered_json balance_json(const Balance<Dim>& balance) {
  Resultant<Dim> loads, reactions;
  for (const auto& load : balance.loads) loads += load.of;
  for (const auto& [part, of] : balance.reactions) reactions += of;
  return {{"loads", json_of<Dim>(loads)}, {"reactions", json_of<Dim>(reactions)}, {"error", balance.error}};
}

/// Only what is known of it.
template <int Dim> nlohmann::ordered_json json_of(const OnSurface<Dim>& numbers) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  if (numbers.strain_energy)
    json["strain_energy"] = {{"value", numbers.strain_energy->value}, {"error", numbers.strain_energy->error}};
  for (const auto& [name, of] : numbers.probes)
    json["probes"][name] = {{"displacement", json_array(of.value)}, {"error", json_array(of.error)}};
  for (const auto& [name, of] : numbers.reactions)
    json["reactions"][name] = {{"force", json_array(of.value)}, {"error", json_array(of.error)}};
  return json;
}

/// What an answer has by itself: energy, estimates, probes, loads and reactions, extremes with their errors.
template <int Dim> void add_values_of(const Answer<Dim>& answer, nlohmann::ordered_json& json) {
  json["strain_energy"] = answer.solution.strain_energy;
  if (answer.estimates)
    json["estimates"]["energy"] = {{"cloud", answer.estimates->cloud},
                                   {"uncorrected", answer.estimates->uncorrected},
                                   {"mesh", answer.estimates->mesh},
                                   {"geometry", answer.estimates->geometry},
                                   {"total", answer.estimates->total()}};
  if (answer.on_surface) json["true_surface"] = json_of(*answer.on_surface);
  json["corrections"] = answer.estimates ? answer.estimates->corrections : 0;
  json["probes"] = nlohmann::ordered_json::object();
  for (const auto& [name, values] : answer.probes)
    json["probes"][name] = {{"displacement", json_array(values.displacement)},
                            {"strain", json_array(values.strain)},
                            {"stress", json_array(values.stress)}};
  for (const auto& [part, of] : answer.balance.reactions) json["reactions"][part] = json_of<Dim>(of);
  for (const auto& [name, values] : answer.probes)
    if (const auto error = answer.probe_errors.find(name); error != answer.probe_errors.end()) {
      json["probes"][name]["error"] = json_array(error->second);
      json["estimates"]["probes"][name] = relative_error<Dim>(values.displacement, error->second);
    }
  for (const auto& reaction : answer.reactions) {
    json["reactions"][reaction.name].update(
        {{"force", json_array(reaction.force)}, {"error", json_array(reaction.error)}});
    json["estimates"]["reactions"][reaction.name] = relative_error<Dim>(reaction.force, reaction.error);
  }
  json["loads"] = nlohmann::ordered_json::array();
  for (const auto& load : answer.balance.loads) {
    nlohmann::ordered_json one = {{"kind", load.kind}};
    if (!load.on.empty()) one["on"] = load.on;
    one.update(json_of<Dim>(load.of));
    json["loads"].push_back(one);
  }
  json["balance"] = balance_json(answer.balance);
  for (const auto& extreme : answer.extremes) {
    json["extremes"][extreme.of] = {{"value", extreme.value}, {"at", json_array(extreme.at)}};
    if (!extreme.error) continue;
    json["extremes"][extreme.of]["error"] = *extreme.error;
    json["estimates"]["extremes"][extreme.of] = extreme.value > 0.0 ? *extreme.error / extreme.value : 0.0;
  }
}

template <int Dim> void add_ranges(const std::vector<FieldRange<Dim>>& ranges, nlohmann::ordered_json& json) {
  for (const auto& range : ranges)
    json["extremes"][range.of] = {{"max", {{"value", range.most}, {"at", json_array(range.most_at)}}},
                                  {"min", {{"value", range.least}, {"at", json_array(range.least_at)}}}};
}

/// Of an image solved on cells.
inline void add_grids(const CellSolution& cells, nlohmann::ordered_json& json) {
  json["strain_energy_extrapolated"] = cells.extrapolated_energy;
  for (const CellLevel& level : cells.levels)
    json["grids"].push_back({{"edges", json_array(level.edges)},
                             {"cells", level.cells},
                             {"iterations", level.iterations},
                             {"strain_energy", level.strain_energy}});
  json["estimates"]["energy"]["image"] = std::sqrt(cells.half_voxel);
}

/// Meshes, or grids, on the way to an accuracy.
inline void add_attempts(const std::vector<Attempt>& attempts, nlohmann::ordered_json& json) {
  for (const Attempt& attempt : attempts)
    json["attempts"].push_back({{"mesh_size", attempt.size},
                                {"fine_cells", attempt.cells},
                                {"degree", attempt.degree},
                                {"error", attempt.error},
                                {"seconds", attempt.seconds}});
  for (std::size_t k = 0; k < attempts.size(); ++k)
    if (attempts[k].spacing > 0.0) json["attempts"][k]["spacing"] = attempts[k].spacing;
}

}  // namespace efree::internal
