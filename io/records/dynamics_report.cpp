// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/dynamics_report.hpp"

#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/records/internal/json_array.hpp"
#include "efree/io/records/internal/region_records.hpp"
#include "efree/io/records/internal/snake_case.hpp"
#include "efree/io/records/internal/utilisation_records.hpp"
#include "efree/io/records/internal/write_json.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <cmath>
#include <nlohmann/json.hpp>

namespace efree {
namespace {

using internal::json_array, internal::snake_case, nlohmann::ordered_json;

double total_time(const Ledger& ledger) {
  double total = 0.0;
  for (const auto& time : ledger.times()) total += time.seconds;
  return total;
}

}  // namespace

template <int Dim> std::string describe_model(const DynamicsModel<Dim>& model) {
  return fmt::format("{} bod{}, {} nodes, {} material points, steps of {:.4g}", model.names.size(),
                     model.names.size() == 1 ? "y" : "ies", model.dynamics.num_nodes(), model.dynamics.num_points(),
                     model.dynamics.stable_step());
}

template <int Dim>
std::vector<std::string> describe_run(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const Ledger ledger = dynamics.ledger(), energies = dynamics.balance().energies;
  std::vector<std::string> counts, parts, shares;
  for (const auto& count : ledger.counts())
    if (count.value != 0) counts.push_back(fmt::format("{} {}", count.value, count.name));
  for (const auto& energy : energies.energies())
    if (energy.value != 0.0) parts.push_back(fmt::format("{} {:.4g}", energy.name, energy.value));
  std::vector<std::string> lines{fmt::format("{} steps to time {:.6g}", dynamics.steps(), dynamics.time())};
  if (!counts.empty()) lines.back() += fmt::format("; {}", fmt::join(counts, ", "));
  lines.push_back(fmt::format("energy: {}{}off by up to {:.2g} %", fmt::join(parts, ", "), parts.empty() ? "" : "; ",
                              100.0 * dynamics.energy().largest_error()));
  if (const double total = total_time(ledger); total > 0.0) {
    for (const auto& time : ledger.times())
      shares.push_back(fmt::format("{} {:.0f} %", time.name, 100.0 * time.seconds / total));
    lines.push_back(fmt::format("{:.3g} million points a second; {}",
                                1e-6 * dynamics.steps() * static_cast<double>(dynamics.num_points()) / total,
                                fmt::join(shares, ", ")));
  }
  if (settings.options.mass_scaling.on()) {
    const AddedInertia inertia = dynamics.added_inertia();
    lines.push_back(
        !inertia.is_known()
            ? "mass scaling: its error is not known, as the run is too short"
            : fmt::format("mass scaling: forces are off by about {:.2g} % of the largest; kinetic over internal "
                          "energy {:.2g} % at most, {:.2g} % in the median",
                          100.0 * inertia.error(), 100.0 * inertia.largest_ratio(), 100.0 * inertia.median_ratio()));
  }
  for (const auto& [name, values] : measure_probes(settings, model))
    lines.push_back(values.size() == 1 ? fmt::format("probe \"{}\": {:.6g}", name, values[0])
                                       : fmt::format("probe \"{}\": displacement ({:.6g}), velocity ({:.6g})", name,
                                                     fmt::join(values.begin(), values.begin() + Dim, ", "),
                                                     fmt::join(values.begin() + Dim, values.end(), ", ")));
  for (const auto& one : largest_utilisations(model)) lines.push_back(internal::utilisation_text(one));
  return lines;
}

namespace {

template <int Dim> ordered_json counts_json(const Dynamics<Dim>& dynamics, const Ledger& ledger) {
  ordered_json json{
      {"nodes", dynamics.num_nodes()}, {"material_points", dynamics.num_points()}, {"steps", dynamics.steps()}};
  for (const auto& count : ledger.counts()) json[snake_case(count.name)] = count.value;
  return json;
}

ordered_json energy_json(const Ledger& energies, const EnergyWatch& watch) {
  ordered_json json{{"start", watch.start}};
  for (const auto& energy : energies.energies()) json[snake_case(energy.name)] = energy.value;
  json["total"] = energies.total();
  double all = 0.0;
  for (const auto& energy : energies.energies()) all += std::abs(energy.value);
  if (all > 0.0)
    for (const auto& energy : energies.energies()) json["fractions"][snake_case(energy.name)] = energy.value / all;
  json["error"] = watch.error();
  json["largest_error"] = watch.largest_error();
  return json;
}

template <int Dim> ordered_json mass_scaling_json(const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const AddedInertia inertia = dynamics.added_inertia();
  ordered_json json;
  const std::vector<BodyMass> masses = dynamics.body_masses();
  for (std::size_t b = 0; b < masses.size(); ++b)
    json["bodies"][model.names[b]] = {{"mass", masses[b].real},
                                      {"added", masses[b].added},
                                      {"added_percent", 100.0 * masses[b].added / masses[b].real},
                                      {"points", masses[b].points}};
  json["unscaled_step"] = dynamics.world().unscaled_step;
  if (!inertia.is_known()) return json;
  json["error"] = inertia.error();
  json["kinetic_over_internal"] = {{"largest", inertia.largest_ratio()}, {"median", inertia.median_ratio()}};
  return json;
}

template <int Dim> ordered_json rigid_body_json(const RigidState<Dim>& body) {
  return {{"centre", json_array(body.centre)}, {"velocity", json_array(body.velocity)}, {"spin", json_array(body.spin)},
          {"force", json_array(body.force)},   {"impulse", json_array(body.impulse)},   {"work", body.work}};
}

template <int Dim> ordered_json contact_json(const typename ContactForces<Dim>::Pair& pair) {
  return {{"body", pair.body},
          {"with", pair.with},
          {"impulse", json_array(pair.impulse)},
          {"peak_force",
           {{"value", pair.peak.norm()},
            {"force", json_array(pair.peak)},
            {"from", pair.peak_begin},
            {"to", pair.peak_end}}}};
}

template <int Dim> ordered_json probes_json(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model) {
  ordered_json json = ordered_json::object();
  for (const auto& [name, values] : measure_probes(settings, model)) {
    if (std::isnan(values[0])) continue;
    if (values.size() > 1)
      json[name] = {{"displacement", std::vector<double>(values.begin(), values.begin() + Dim)},
                    {"velocity", std::vector<double>(values.begin() + Dim, values.end())}};
    else
      json[name] = values[0];
  }
  return json;
}

template <int Dim> ordered_json extremes_json(const Dynamics<Dim>& dynamics) {
  ordered_json json = ordered_json::object();
  const Points<Dim> points = dynamics.points();
  if (points.cols() == 0) return json;
  for (const auto& [name, values] : point_scalars(dynamics)) {
    Index largest = 0, smallest = 0;
    values.maxCoeff(&largest);
    values.minCoeff(&smallest);
    json[name] = {{"max", {{"value", values[largest]}, {"at", json_array(points.col(largest))}}},
                  {"min", {{"value", values[smallest]}, {"at", json_array(points.col(smallest))}}}};
  }
  return json;
}

}  // namespace

template <int Dim> void write_dynamics_result(const std::filesystem::path& file, const DynamicsCase<Dim>& dynamics_case,
                                              const DynamicsModel<Dim>& model, const ContactForces<Dim>& contacts,
                                              const DynamicsOutcome& outcome, const std::vector<std::string>& warnings,
                                              const StageTimes& times) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const auto balance = dynamics.balance();
  const Ledger ledger = dynamics.ledger();
  ordered_json json;
  json["title"] = dynamics_case.common.title;
  json["kind"] = "dynamics";
  json["method"] = dynamics.scheme();
  json["dimension"] = Dim;
  json["bodies"] = model.names;
  json["time"] = dynamics.time();
  if (!outcome.stop_reason.empty()) json["stopped"] = outcome.stop_reason;
  if (outcome.residual) json["relaxation"] = {{"residual", *outcome.residual}, {"at_rest", outcome.at_rest}};
  json["counts"] = counts_json(dynamics, ledger);
  json["stable_step"] = dynamics.stable_step();
  if (dynamics_case.options.mass_scaling.on()) json["mass_scaling"] = mass_scaling_json(model);
  json["energy"] = energy_json(balance.energies, dynamics.energy());
  json["momentum"] = json_array(balance.momentum);
  json["angular_momentum"] = json_array(balance.angular_momentum);
  for (const RigidState<Dim>& body : dynamics.rigid_bodies()) json["rigid_bodies"].push_back(rigid_body_json(body));
  const Points<Dim> walls = dynamics.wall_forces();
  for (Index w = 0; w < walls.cols(); ++w) json["walls"].push_back({{"force", json_array(walls.col(w))}});
  for (const auto& pair : contacts.pairs()) json["contacts"].push_back(contact_json<Dim>(pair));
  json["probes"] = probes_json<Dim>(dynamics_case, model);
  json["extremes"] = extremes_json(dynamics);
  internal::add_regions(model, json);
  internal::add_utilisations(largest_utilisations(model), json);
  json["reports"]["warnings"] = warnings;
  if (const double total = total_time(ledger); total > 0.0)
    for (const auto& time : ledger.times()) json["shares"][snake_case(time.name)] = time.seconds / total;
  for (const auto& [stage, seconds] : times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["threads"] = num_threads();
  json["version"] = version();
  internal::write_json(file, json);
}

#define EFREE_INSTANTIATE(Dim)                                                                                      \
  template std::string describe_model(const DynamicsModel<Dim>&);                                                   \
  template std::vector<std::string> describe_run(const DynamicsSettings<Dim>&, const DynamicsModel<Dim>&);          \
  template void write_dynamics_result(const std::filesystem::path&, const DynamicsCase<Dim>&,                       \
                                      const DynamicsModel<Dim>&, const ContactForces<Dim>&, const DynamicsOutcome&, \
                                      const std::vector<std::string>&, const StageTimes&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
