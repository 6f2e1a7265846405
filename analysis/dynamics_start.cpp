// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/dynamics_start.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <set>

namespace efree::internal {
namespace {

/// Depth over the spacing up to which nodes of an earlier run may be inside rigid bodies.
constexpr double allowed_depth = 0.05;

/// Vertices that are not nodes go with the displacement of these.
template <int Dim>
void move_surfaces(const Points<Dim>& moved, const Dynamics<Dim>& dynamics, std::vector<RegionBody<Dim>>& regions) {
  for (std::size_t b = 0; b < regions.size(); ++b)
    for (auto& [name, part] : regions[b].surfaces) {
      if (part.positions.cols() == 0 || part.positions.cols() != part.functions.rows()) continue;
      const Index first = dynamics.first_node(static_cast<Index>(b));
      part.positions += (part.functions * moved.middleCols(first, part.functions.cols()).transpose()).transpose();
    }
}

std::string body_name(const std::string& region, std::size_t count) {
  return count == 1 ? "the body" : fmt::format("body \"{}\"", region);
}

template <int Dim> void report_masses(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model) {
  const MassScaling& scaling = settings.options.mass_scaling;
  if (!scaling.on()) return;
  const Dynamics<Dim>& dynamics = model.dynamics;
  const std::vector<BodyMass> masses = dynamics.body_masses();
  for (std::size_t b = 0; b < masses.size(); ++b) {
    const auto& [real, added, points] = masses[b];
    const auto all = dynamics.first_point(static_cast<Index>(b) + 1) - dynamics.first_point(static_cast<Index>(b));
    model.remarks.push_back(fmt::format(
        "mass scaling: {} of mass {:.4g} has {:.4g} added ({:.3g} %{})", body_name(model.names[b], masses.size()), real,
        added, 100.0 * added / real,
        scaling.step > 0.0 ? fmt::format("; up to the wanted step at {} of {} material points", points, all) : ""));
  }
  model.remarks.push_back(fmt::format("mass scaling: stable steps of {:.4g} instead of {:.4g}", dynamics.stable_step(),
                                      dynamics.world().unscaled_step));
}

/// Nodes that walls and rigid bodies touch.
template <int Dim>
std::vector<Index> nodes_in_contact(const DynamicsSettings<Dim>& settings, const Dynamics<Dim>& dynamics) {
  const Nodes<Dim>& nodes = dynamics.world().nodes;
  std::set<Index> result;
  const auto look = [&](const RigidShape<Dim>& shape) {
    for (Index a = 0; a < nodes.size(); ++a)
      if (shape(nodes.x.col(a)).gap < 1e-3 * nodes.spacing[a] + (nodes.radius.size() == 0 ? 0.0 : nodes.radius[a]))
        result.insert(a);
  };
  for (const auto& [wall, where] : settings.walls) look(rigid_shapes::half_space<Dim>(wall.normal, wall.level));
  for (const auto& [body, where] : settings.rigid_bodies) look(body.shape);
  return {result.begin(), result.end()};
}

template <int Dim> void report_stresses(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model) {
  if (settings.initial_stresses.empty()) return;
  if (const std::string scheme = model.dynamics.scheme(); !model.dynamics.nodes_persist() || scheme == "sph") {
    model.remarks.push_back(
        fmt::format("stresses at the start: how far they are from equilibrium is not known by the "
                    "method \"{}\"; if they are not, bodies move at once (energy.kinetic)",
                    scheme));
    return;
  }
  const double imbalance = model.dynamics.imbalance(nodes_in_contact(settings, model.dynamics));
  model.remarks.push_back(fmt::format("stresses at the start: {:.2g} of the forces is not balanced", imbalance));
  if (imbalance > warned_stress_imbalance && !settings.static_start)
    model.warnings.push_back(fmt::format(
        "Bodies move at the start: the given stresses and loads are not in equilibrium, {:.2g} of the forces is "
        "not balanced. Check signs and supports, or add static = true to [start]",
        imbalance));
}

}  // namespace

template <int Dim> void begin_from_state(const DynamicsSettings<Dim>& settings, std::vector<RegionBody<Dim>>& regions,
                                         DynamicsModel<Dim>& model) {
  if (!settings.state_start) return;
  const StateStart& start = *settings.state_start;
  Dynamics<Dim>& dynamics = model.dynamics;
  const Points<Dim> nodes = dynamics.nodes(), velocities = dynamics.velocities();
  const Index num_points = dynamics.num_points();
  const auto fail = [&](const std::string& what) {
    throw InputError(said_at(start.where, fmt::format("the state in {}: {}", start.directory, what)));
  };
  try {
    dynamics.begin_from(start.state, start.velocities, model.names);
  } catch (const InputError& error) {
    fail(error.what());
  }
  const bool persists = dynamics.nodes_persist();
  const bool is_same = persists ? dynamics.num_nodes() == nodes.cols() : dynamics.num_points() == num_points;
  if (!is_same &&
      (!settings.boundary_velocities.empty() || !settings.boundary_loads.empty() || !settings.gases.empty()))
    fail(
        fmt::format("the earlier run has inserted or removed nodes or points ({} now, {} at its start), so that the "
                    "nodes of a [[boundary]] or [[gas]] are not known: leave these out",
                    persists ? dynamics.num_nodes() : dynamics.num_points(), persists ? nodes.cols() : num_points));
  if (!persists && !settings.boundary_loads.empty())
    fail(
        fmt::format("loads on boundaries need nodes that stay with the material, and the method is \"{}\": take "
                    "method = \"otm\", or a [cloud], in both runs",
                    dynamics.scheme()));
  if (is_same && persists) move_surfaces<Dim>(dynamics.nodes() - nodes, dynamics, regions);
  if (settings.initial_velocities.empty()) return;
  if (!is_same || !persists)
    fail("initial velocities need the nodes of the start of the earlier run: leave out [[velocity]]");
  dynamics.set_velocities(velocities);
}

template <int Dim> void set_initial_stresses(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model) {
  if (settings.initial_stresses.empty()) return;
  std::vector<const InitialStress<Dim>*> by_body(model.names.size(), nullptr);
  for (const InitialStress<Dim>& one : settings.initial_stresses)
    for (std::size_t b = 0; b < by_body.size(); ++b)
      if (one.region == model.names[b] || (one.region.empty() && !by_body[b])) by_body[b] = &one;
  located(settings.common, settings.initial_stresses.front().where, [&] {
    model.dynamics.set_stresses([&](Index body, const Vec<Dim>& x) -> std::optional<Mat<3>> {
      const InitialStress<Dim>* of = by_body[static_cast<std::size_t>(body)];
      if (!of) return {};
      return of->stress(x);
    });
  });
}

template <int Dim> double allowed_gap(const DynamicsSettings<Dim>& settings, const DynamicsModel<Dim>& model) {
  const double rounding = 1e-6 * (model.initial_box.max() - model.initial_box.min()).norm();
  if (!settings.state_start) return rounding;
  return std::max(rounding, allowed_depth * model.dynamics.world().nodes.spacing.minCoeff());
}

template <int Dim> void report_start(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model) {
  if (settings.state_start)
    model.remarks.push_back(fmt::format("start from the state in {}{}", settings.state_start->directory,
                                        settings.state_start->velocities ? "" : ", at rest"));
  report_masses(settings, model);
  report_stresses(settings, model);
}

template <int Dim>
void come_to_rest(const DynamicsSettings<Dim>& settings, const Monitor& monitor, DynamicsModel<Dim>& model) {
  if (!settings.static_start) return;
  const Stage stage("rest", monitor);
  Dynamics<Dim>& dynamics = model.dynamics;
  const auto& [residual, most_steps, spin, where] = *settings.static_start;
  if (!dynamics.nodes_persist())
    throw InputError(said_at(where,
                             "a start from rest needs nodes that stay with the material: take dynamics.method = "
                             "\"otm\", or a [cloud], or mpm.frame = \"total\""));
  const Points<Dim> initial = dynamics.velocities();
  const Stopwatch seconds;
  double first = 0.0;
  const auto look = [&, wanted = residual](double left) {
    if (monitor.cancelled && monitor.cancelled()) throw Cancelled("rest");
    if (seconds() > settings.time_limit)
      throw NumericalError(
          fmt::format("bodies are not at rest when the time limit of {:.6g} s is over: the residual is "
                      "{:.3g}, expected {:.3g}",
                      settings.time_limit, left, wanted));
    if (!std::isfinite(left)) return;
    if (first == 0.0) first = left;
    stage.tick(std::clamp(std::log(left / first) / std::log(wanted / first), 0.0, 1.0));
    if (monitor.detail) monitor.detail(fmt::format("residual {:.2g} of {:.2g}", left, wanted));
  };
  located(settings.common, where, [&] { dynamics.come_to_rest(residual, most_steps, spin, look); });
  dynamics.set_velocities(initial + dynamics.velocities());
}

#define EFREE_INSTANTIATE(Dim)                                                                                      \
  template void begin_from_state(const DynamicsSettings<Dim>&, std::vector<RegionBody<Dim>>&, DynamicsModel<Dim>&); \
  template void set_initial_stresses(const DynamicsSettings<Dim>&, DynamicsModel<Dim>&);                            \
  template double allowed_gap(const DynamicsSettings<Dim>&, const DynamicsModel<Dim>&);                             \
  template void report_start(const DynamicsSettings<Dim>&, DynamicsModel<Dim>&);                                    \
  template void come_to_rest(const DynamicsSettings<Dim>&, const Monitor&, DynamicsModel<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
