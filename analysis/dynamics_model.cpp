// SPDX-License-Identifier: GPL-3.0-or-later
/// From a geometry and settings to a model of explicit dynamics.
#include "efree/analysis/dynamics.hpp"
#include "efree/analysis/internal/dynamics_checks.hpp"
#include "efree/analysis/internal/dynamics_start.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/prepare_mesh.hpp"
#include "efree/analysis/internal/region_body.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/dynamics/contact/close_contacts.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <ranges>
#include <set>
#include <utility>

namespace efree {
namespace {

using internal::is_axisymmetric, internal::with_origin;
using internal::located, internal::said_at, internal::where_said;

/// Names of regions and parts of the boundary, and the sign of the radius.
template <int Dim> void check_regions(const FineMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings) {
  const auto check = [&](const std::string& region, const std::string& where) {
    if (!region.empty()) located(settings.common, where, [&] { return mesh.region(region); });
  };
  for (const auto& initial : settings.initial_velocities) check(initial.region, initial.where);
  for (const auto& fracture : settings.fractures) check(fracture.region, fracture.where);
  for (const auto& stress : settings.initial_stresses) check(stress.region, stress.where);
  for (const auto& part : settings.boundary_velocities) located(settings.common, "", [&] { mesh.group(part.on); });
  for (const auto& load : settings.boundary_loads) located(settings.common, load.where, [&] { mesh.group(load.on); });
  for (const auto& gas : settings.gases) located(settings.common, gas.where, [&] { mesh.group(gas.on); });
  if (is_axisymmetric(settings) && mesh.vertices().row(0).minCoeff() < 0.0)
    throw InputError(said_at(where_said(settings.common, "analysis.plane"),
                             fmt::format("axisymmetric: x is the radius, and the body reaches to x = {:.6g}",
                                         mesh.vertices().row(0).minCoeff())));
}

template <int Dim>
void check_field(const DynamicsModel<Dim>& model, const std::string& field, const std::string& where) {
  if (field.empty()) return;
  std::vector<std::string> fields;
  for (const auto& [name, values] : point_scalars(model.dynamics)) fields.push_back(name);
  if (std::ranges::find(fields, field) == fields.end())
    throw InputError(
        said_at(where, fmt::format("there is no field \"{}\"; the points have {}", field, fmt::join(fields, ", "))));
}

/// The node that is nearest to the probe's position, and its distance.
template <int Dim>
std::pair<ProbeNode<Dim>, double> nearest_node(const DynamicsProbe<Dim>& probe, const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const Points<Dim> at = model.probes_points ? dynamics.points() : dynamics.nodes();
  std::pair<ProbeNode<Dim>, double> nearest{{}, std::numeric_limits<double>::infinity()};
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    if (!probe.region.empty() && probe.region != model.names[b]) continue;
    const Index first = model.first_probed(b);
    for (Index a = first; a < model.first_probed(b + 1); ++a)
      if (const double distance = (at.col(a) - probe.at).norm(); distance < nearest.second)
        nearest = {{.body = b, .number = a - first, .start = at.col(a)}, distance};
  }
  return nearest;
}

/// Checks the probes, and finds their nodes.
template <int Dim> void set_up_probes(const DynamicsSettings<Dim>& settings, DynamicsModel<Dim>& model) {
  for (const auto& probe : settings.probes) {
    check_field(model, probe.field, probe.where);
    if (!probe.region.empty() && std::ranges::find(model.names, probe.region) == model.names.end())
      throw InputError(said_at(probe.where, fmt::format("there is no region \"{}\"; the mesh has \"{}\"", probe.region,
                                                        fmt::join(model.names, "\", \""))));
    model.probe_nodes.emplace_back();
    if (probe.kind == DynamicsProbe<Dim>::Kind::node) {
      const auto [node, distance] = nearest_node(probe, model);
      model.probe_nodes.back() = node;
      model.remarks.push_back(fmt::format("probe \"{}\": the {} at ({:.6g}), {:.3g} from its position", probe.name,
                                          model.probes_points ? "material point" : "node", fmt::join(node.start, ", "),
                                          distance));
    } else if (probe.kind != DynamicsProbe<Dim>::Kind::mean_force && probe.field.empty()) {
      located(settings.common, probe.where, [&] { return probe.coordinate(model.dynamics.nodes().col(0)); });
    }
  }
}

/// Forces are momenta over a step, which has to be large enough to divide by.
template <int Dim> void check_times(const DynamicsSettings<Dim>& settings, double stable) {
  constexpr double least = 1e-12;
  for (const auto& [name, time] : {std::pair("end", settings.end), std::pair("max_step", settings.max_step)})
    if (time < least * stable)
      throw InputError(said_at(
          where_said(settings.common, std::string("time.") + name),
          fmt::format("{} is {:.3g}, next to nothing compared with a stable step, {:.3g}", name, time, stable)));
}

/// Whether the method ties regions that touch.
template <int Dim> bool can_tie(const DynamicsSettings<Dim>& settings) {
  switch (settings.method) {
    case DynamicsMethod::otm:
      return !settings.otm.seizing;
    case DynamicsMethod::mpm:
      return settings.mpm.frame != MpmFrame::total;
    case DynamicsMethod::sph:
      return settings.sph.frame == SphFrame::updated;
    default:
      return false;
  }
}
template <int Dim> bool ties_regions(const FineMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings) {
  return settings.tied && can_tie(settings) && !tied_facets(mesh).empty();
}

/// Bodies whose regions touch.
template <int Dim> std::vector<std::pair<Index, Index>> touching_bodies(const FineMesh<Dim>& mesh) {
  std::vector<Index> body(mesh.num_regions(), -1);  // regions without cells have none
  for (Index c = 0; c < mesh.num_cells(); ++c) body[mesh.region(c)] = 0;
  Index count = 0;
  for (Index& of : body)
    if (of == 0) of = count++;
  std::set<std::pair<Index, Index>> pairs;
  for (const auto& [first, second] : tied_facets(mesh))
    pairs.emplace(body[mesh.region(mesh.facet_cell(first))], body[mesh.region(mesh.facet_cell(second))]);
  return {pairs.begin(), pairs.end()};
}

template <int Dim> void add_warnings(const PreparedMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings,
                                     const std::vector<std::string>& without_inner_nodes, DynamicsModel<Dim>& model) {
  model.warnings = mesh.warnings;
  if (const auto ties = tied_facets(*mesh.mesh); ties_regions(*mesh.mesh, settings))
    model.remarks.push_back(fmt::format("regions that touch are tied, along {} facets", ties.size()));
  else if (!ties.empty() && settings.tied)
    model.warnings.push_back(
        fmt::format("Regions are not tied to each other: they touch along {} facets, and every region is a body of its "
                    "own. Take dynamics.method = \"otm\" or \"mpm\" (frame = \"updated\" or \"mesh\") to tie them, or "
                    "contact.tie = false if they are to part",
                    ties.size()));
  if (!without_inner_nodes.empty())
    model.warnings.push_back(fmt::format(
        "Bending and squeezing of {} are not resolved: no node lies inside. Try a smaller mesh_size",
        mesh.mesh->num_regions() == 1 ? "the body" : fmt::format("\"{}\"", fmt::join(without_inner_nodes, "\", \""))));
  if (settings.method == DynamicsMethod::mpm && settings.mpm.frame == MpmFrame::mesh) {
    const double edge = internal::mean_edge(*mesh.mesh);
    if (edge > settings.mpm.options.cell)
      model.warnings.push_back(fmt::format(
          "The mesh is coarser than the grid: edges of about {:.3g}, cells of {:.3g}, so results are as coarse as the "
          "mesh. Try a mesh_size of half of mpm.cell",
          edge, settings.mpm.options.cell));
  }
  std::ranges::copy(internal::warnings_of_speeds(model), std::back_inserter(model.warnings));
  if (lacks_contact(settings) && model.dynamics.num_bodies() > 1)
    model.warnings.emplace_back(
        settings.method == DynamicsMethod::sph
            ? "Bodies pass through each other: with sph.frame = \"total\" there is contact with walls and rigid bodies "
              "only. Take frame = \"updated\" if bodies meet"
        : settings.method == DynamicsMethod::mpm
            ? "Bodies pass through each other: with mpm.frame = \"total\" there is contact with walls and rigid bodies "
              "only. Take frame = \"updated\" if bodies meet"
            : "Bodies pass through each other: on a [cloud] there is contact with walls and rigid bodies only. Leave "
              "out "
              "[cloud] if bodies meet");
}

template <int Dim>
std::unique_ptr<Scheme<Dim>> make_scheme(const FineMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings) {
  if (settings.method == DynamicsMethod::otm) return otm<Dim>(settings.otm);
  if (settings.method == DynamicsMethod::mpm && settings.mpm.frame != MpmFrame::total) {
    MpmOptions options = with_origin(settings.mpm.options, mesh);
    if (ties_regions(mesh, settings)) options.ties = touching_bodies(mesh);
    return mpm<Dim>(options);
  }
  if (settings.method == DynamicsMethod::sph && settings.sph.frame == SphFrame::updated)
    return sph<Dim>(with_origin(settings.sph.options, mesh));
  return total_lagrangian<Dim>();
}

/// Vertices that rounding has left beside the axis are on it.
void move_onto_axis(PreparedMesh<2>& prepared) {
  constexpr double rounding = 1e-10;  // of the size of the mesh
  const FineMesh<2>& mesh = *prepared.mesh;
  if (const double least = mesh.vertices().row(0).minCoeff(); least >= 0.0 || least < -rounding * mesh.size()) return;
  MeshData<2> data = extract(mesh, std::vector<char>(static_cast<std::size_t>(mesh.num_cells()), 1));
  for (auto vertex : data.vertices.colwise())
    if (std::abs(vertex[0]) <= rounding * mesh.size()) vertex[0] = 0.0;
  prepared.mesh = std::make_shared<const FineMesh<2>>(std::move(data));
}

/// Of regions whose volumes close_contacts has changed by more than warned_volume_change; empty: there are none.
std::string warn_of_volumes(const std::vector<std::string>& regions, const Vector& change) {
  std::vector<std::string> changed;
  for (Index r = 0; r < change.size(); ++r)
    if (std::abs(change[r]) > warned_volume_change)
      changed.push_back(fmt::format("\"{}\" ({:+.2g} %)", regions[static_cast<std::size_t>(r)], 100.0 * change[r]));
  if (changed.empty()) return {};
  return fmt::format(
      "Masses and stiffnesses are those of changed bodies: contact.close has changed the volume of {}. Where that is "
      "too much, fit the bodies to each other in the geometry",
      fmt::join(changed, ", "));
}

/// DynamicsSettings::closed_gap.
template <int Dim> void close_gaps(const DynamicsSettings<Dim>& settings, PreparedMesh<Dim>& prepared) {
  FineMesh<Dim> mesh = *prepared.mesh;
  const ClosedContacts closed = located(settings.common, where_said(settings.common, "contact.close"), [&] {
    return close_contacts(mesh, settings.closed_gap, is_axisymmetric(settings));
  });
  if (closed.vertices == 0)
    prepared.warnings.push_back(fmt::format(
        "No gaps or overlaps are closed: between regions there are none of up to contact.close = {:.6g} that facets of "
        "both face",
        settings.closed_gap));
  else
    prepared.remarks.push_back(
        fmt::format("gaps and overlaps between regions are closed: {} vertices, moved by up to {:.3g}", closed.vertices,
                    closed.furthest));
  if (std::string warning = warn_of_volumes(mesh.region_names(), closed.volume_change); !warning.empty())
    prepared.warnings.push_back(std::move(warning));
  if (closed.overlap > 0.01 * settings.closed_gap)
    prepared.warnings.push_back(
        fmt::format("Bodies overlap by up to {:.3g} after contact.close: contact pushes them apart in the first steps. "
                    "Try a smaller mesh_size, so that facets of both fit each other",
                    closed.overlap));
  prepared.volume_change = closed.volume_change;
  prepared.mesh = std::make_shared<const FineMesh<Dim>>(std::move(mesh));
}

}  // namespace

template <int Dim> DynamicsModel<Dim> build_dynamics_model(const PreparedMesh<Dim>& mesh,
                                                           const DynamicsSettings<Dim>& settings,
                                                           const Monitor& monitor) {
  check_regions(*mesh.mesh, settings);
  internal::MeshBodies<Dim> built = internal::build_bodies(mesh, settings, monitor);
  const Stage stage("bodies", monitor);
  DynamicsOptions options = settings.options;
  options.plane = settings.common.model.plane.value_or(Plane::strain);
  if (lacks_contact(settings)) options.contact.enabled = false;  // there are no surfaces
  options.tied = settings.method == DynamicsMethod::otm && ties_regions(*mesh.mesh, settings);
  const auto num_points = static_cast<Index>(built.point_sizes.size());
  require_memory(internal::bytes_per_point * num_points,
                 fmt::format("explicit dynamics of {} material points", num_points),
                 "take a coarser mesh, or a [cloud]");
  std::vector<DeformableBody<Dim>> bodies;
  for (auto& region : built.regions) bodies.push_back(std::move(region.body));
  DynamicsModel<Dim> model{
      .dynamics = located(settings.common, settings.common.where,
                          [&] { return Dynamics<Dim>(std::move(bodies), make_scheme(*mesh.mesh, settings), options); }),
      .names = std::move(built.names),
      .initial_box = {},
      .volume_changes = std::move(built.volume_changes),
      .point_sizes = Eigen::Map<const Vector>(built.point_sizes.data(), num_points)};
  internal::begin_from_state(settings, built.regions, model);
  internal::set_initial_stresses(settings, model);
  model.probes_points = settings.method == DynamicsMethod::mpm ||
                        (settings.method == DynamicsMethod::sph && settings.sph.frame == SphFrame::total);
  const Points<Dim> nodes = model.probes_points ? model.dynamics.points() : model.dynamics.nodes();
  model.initial_box = {nodes.rowwise().minCoeff(), nodes.rowwise().maxCoeff()};
  internal::check_rigid_bodies(settings);
  internal::check_gaps(settings, settings.state_start ? nodes : mesh.mesh->vertices(),
                       internal::allowed_gap(settings, model));
  internal::check_overlaps(settings, model);
  internal::add_loads(settings, built.regions, model);
  add_warnings(mesh, settings, built.without_inner_nodes, model);
  set_up_probes(settings, model);
  check_times(settings, model.dynamics.stable_step());
  internal::report_start(settings, model);
  internal::come_to_rest(settings, built.regions, monitor, model);
  return model;
}

template <int Dim> PreparedMesh<Dim> prepare(const MeshSource<Dim>& source, const DynamicsSettings<Dim>& settings,
                                             const Monitor& monitor) {
  PreparedMesh<Dim> result = internal::prepare_mesh<Dim>(source, settings.common, nullptr, monitor);
  if constexpr (Dim == 2)
    if (is_axisymmetric(settings)) move_onto_axis(result);
  if (settings.closed_gap > 0.0) close_gaps(settings, result);
  return result;
}

template PreparedMesh<2> prepare(const MeshSource<2>&, const DynamicsSettings<2>&, const Monitor&);
template PreparedMesh<3> prepare(const MeshSource<3>&, const DynamicsSettings<3>&, const Monitor&);
template DynamicsModel<2> build_dynamics_model(const PreparedMesh<2>&, const DynamicsSettings<2>&, const Monitor&);
template DynamicsModel<3> build_dynamics_model(const PreparedMesh<3>&, const DynamicsSettings<3>&, const Monitor&);

}  // namespace efree
