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
/// Displacement of a body as a whole before the run, over the spacing, up to which there is no warning: it closes the
/// gaps that chords of curved surfaces leave.
constexpr double allowed_displacement = 0.05;

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

/// 1 along axes in which neither supports nor springs hold the body as a whole, else 0.
template <int Dim> Vec<Dim> free_axes(const DynamicsSettings<Dim>& settings, const World<Dim>& world, Index body,
                                      const RegionBody<Dim>& region) {
  Vec<Dim> free = Vec<Dim>::Ones();
  if (is_axisymmetric(settings)) free[0] = 0.0;
  for (const auto& one : world.prescribed)
    if (world.nodes.body[one.node] == body) free[one.axis] = 0.0;
  for (const auto& [on, load, force, where] : settings.boundary_loads)
    if (region.surfaces.contains(on)) free = (load.stiffness.array() > 0.0).select(Vec<Dim>::Zero(), free);
  return free;
}

/// The partner whose contact acts most against a direction on a body; none: no contact does.
template <int Dim> std::optional<ContactPartner> partner_against(const std::vector<ContactImpulse<Dim>>& contacts,
                                                                 const ContactPartner& body, const Vec<Dim>& along) {
  std::optional<ContactPartner> result;
  double most = 0.0;
  for (const auto& [first, second, impulse, angular_impulse] : contacts) {
    if (first != body && second != body) continue;
    const double against = (first == body ? -1.0 : 1.0) * along.dot(impulse);
    if (!(against > most)) continue;
    most = against;
    result = first == body ? second : first;
  }
  return result;
}

/// Warns of bodies that contact alone holds, but not where they were. Such a body has moved as a whole: all of its
/// points further than any of the partner, which may be deformed by it. start: points before the bodies came to rest;
/// contacts: impulses since then.
template <int Dim>
void report_rigid_displacements(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                const Points<Dim>& start, const std::vector<ContactImpulse<Dim>>& contacts,
                                DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const World<Dim>& world = dynamics.world();
  if (dynamics.num_points() != start.cols()) return;  // inserted or merged: which is which is not known
  const Points<Dim> moved = dynamics.points() - start;
  const auto moved_along = [&](const Vec<Dim>& along, Index b) {
    const Index first = dynamics.first_point(b);
    return Vector(moved.middleCols(first, dynamics.first_point(b + 1) - first).transpose() * along);
  };
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    Vec<Dim> along = free_axes(settings, world, b, regions[static_cast<std::size_t>(b)]);
    for (int i = 0; i < Dim; ++i) along[i] *= moved_along(Vec<Dim>::Unit(i), b).mean();
    along.normalize();
    const auto partner = partner_against(contacts, body_partner(b), along);
    if (!partner) continue;
    double distance = moved_along(along, b).minCoeff();
    if (partner->kind == ContactPartner::Kind::body) distance -= moved_along(along, partner->number).maxCoeff();
    const Index first = dynamics.first_node(b), count = dynamics.first_node(b + 1) - first;
    if (!(distance > allowed_displacement * world.nodes.spacing.segment(first, count).minCoeff())) continue;
    model.warnings.push_back(fmt::format(
        "Positions at the start are not those of the geometry: before the run {} moved as a whole by {:.3g}, until "
        "contact with {} held it, as nothing else does. Close gaps, hold the body by a [[boundary]] or friction, or "
        "leave out [start] if it is to fall or slide",
        body_name(model.names[static_cast<std::size_t>(b)], model.names.size()), distance,
        partner->kind == ContactPartner::Kind::body
            ? body_name(model.names[static_cast<std::size_t>(partner->number)], model.names.size())
            : rigid_partner_name(*partner)));
  }
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

template <int Dim> void come_to_rest(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                     const Monitor& monitor, DynamicsModel<Dim>& model) {
  if (!settings.static_start) return;
  const Stage stage("rest", monitor);
  Dynamics<Dim>& dynamics = model.dynamics;
  const auto& [residual, most_steps, spin, where] = *settings.static_start;
  if (!dynamics.nodes_persist())
    throw InputError(said_at(where,
                             "a start from rest needs nodes that stay with the material: take dynamics.method = "
                             "\"otm\", or a [cloud], or mpm.frame = \"total\""));
  const Points<Dim> initial = dynamics.velocities(), start = dynamics.points();
  std::vector<ContactImpulse<Dim>> contacts;
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
    contacts = dynamics.contacts();
    if (first == 0.0) first = left;
    stage.tick(std::clamp(std::log(left / first) / std::log(wanted / first), 0.0, 1.0));
    if (monitor.detail) monitor.detail(fmt::format("residual {:.2g} of {:.2g}", left, wanted));
  };
  located(settings.common, where, [&] { dynamics.come_to_rest(residual, most_steps, spin, look); });
  if (!settings.initial_velocities.empty()) {
    if (initial.cols() != dynamics.num_nodes())
      throw InputError(said_at(where,
                               "initial velocities need the nodes of the geometry, and nodes were inserted or merged "
                               "until bodies were at rest: leave out [[velocity]], or otm.insertion"));
    dynamics.set_velocities(initial + dynamics.velocities());
  }
  report_rigid_displacements(settings, regions, start, contacts, model);
}

#define EFREE_INSTANTIATE(Dim)                                                                                      \
  template void begin_from_state(const DynamicsSettings<Dim>&, std::vector<RegionBody<Dim>>&, DynamicsModel<Dim>&); \
  template void set_initial_stresses(const DynamicsSettings<Dim>&, DynamicsModel<Dim>&);                            \
  template double allowed_gap(const DynamicsSettings<Dim>&, const DynamicsModel<Dim>&);                             \
  template void report_start(const DynamicsSettings<Dim>&, DynamicsModel<Dim>&);                                    \
  template void come_to_rest(const DynamicsSettings<Dim>&, const std::vector<RegionBody<Dim>>&, const Monitor&,     \
                             DynamicsModel<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
