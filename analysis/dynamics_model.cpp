// SPDX-License-Identifier: GPL-3.0-or-later
/// From a geometry and settings to a model of explicit dynamics.
#include "efree/analysis/dynamics.hpp"
#include "efree/analysis/internal/dynamics_checks.hpp"
#include "efree/analysis/internal/dynamics_start.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/prepare_mesh.hpp"
#include "efree/analysis/internal/region_body.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/dynamics/contact/close_contacts.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/mesh/internal/extract_region.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/rankine.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numbers>
#include <ranges>
#include <set>
#include <utility>

namespace efree {
namespace {

using internal::is_axisymmetric, internal::RegionBody;
using internal::located, internal::said_at, internal::where_said;

/// Place of a region's material in the case file, and its density.
template <int Dim>
std::pair<std::string, Parameter> density_of(const DynamicsSettings<Dim>& settings, const std::string& region) {
  std::string where = where_said(settings.common, "material");
  Parameter density = settings.common.density;
  for (const auto& material : settings.common.materials)
    if (material.region == region) {
      where = material.where;
      density = material.density;
    }
  if (density.is_constant() && !(density.at(Vec<3>::Zero()) > 0.0))
    throw InputError(said_at(where, "density is missing: explicit dynamics needs one of every material"));
  return {where, density};
}

template <int Dim> void set_density(const Parameter& density, DeformableBody<Dim>& body) {
  if (density.is_constant()) {
    body.density = density.at(Vec<3>::Zero());
    return;
  }
  body.densities.resize(body.points.cols());
  for (Index p = 0; p < body.points.cols(); ++p) {
    Vec<3> X = Vec<3>::Zero();
    X.template head<Dim>() = body.points.col(p);
    body.densities[p] = density.at(X);
  }
}

bool has_plastic_strain(const Material& material) {
  return std::ranges::any_of(material.history_parts(),
                             [](const HistoryPart& part) { return part.name == "equivalent_plastic_strain"; });
}

constexpr double bytes_per_point = 4e3;  // measured, with a checkpoint

template <int Dim> const std::vector<Index>* facets_of(const FineMesh<Dim>& mesh, const std::string& part) {
  const auto group = std::ranges::find(mesh.groups(), part, &FineMesh<Dim>::Group::name);
  return group == mesh.groups().end() ? nullptr : &group->facets;
}

template <int Dim> std::set<Index> vertices_of(const FineMesh<Dim>& mesh, const std::vector<Index>& facets) {
  std::set<Index> result;
  for (const Index f : facets)
    for (int i = 0; i < Dim; ++i) result.insert(mesh.facets()(i, f));
  return result;
}

/// Parts of the boundary with loads or a gas.
template <int Dim> std::set<std::string> loaded_parts(const DynamicsSettings<Dim>& settings) {
  std::set<std::string> result;
  for (const auto& gas : settings.gases) result.insert(gas.on);
  for (const auto& load : settings.boundary_loads) result.insert(load.on);
  return result;
}

template <int Dim> bool has_pressure_patches(const DynamicsSettings<Dim>& settings, const Material& material) {
  const bool is_shocked_fluid = settings.options.shock.on() && dynamic_cast<const Fluid*>(&material) != nullptr;
  return settings.pressure_patches.value_or(!is_shocked_fluid);
}

/// Whether moving least squares, or splines, lock without pressure patches.
bool locks(const Material& material) {
  const auto rest = respond(material, Deformation::none(Points<3>::Zero(3, 1), material.history_size()), true);
  const bool keeps_volume = !material.elastic() && dynamic_cast<const Rankine*>(&material) == nullptr;  // as it flows
  return keeps_volume || incompressibility(rest.tangent_at(0)) > bearable_incompressibility(BasisKind::mls);
}

template <int Dim> bool averages_dilatation(const DynamicsSettings<Dim>& settings, const Material& material) {
  return settings.pressure_patches.value_or(has_pressure_patches(settings, material) && locks(material));
}

template <int Dim> RegionBody<Dim> body_at_vertices(const FineMesh<Dim>& mesh, const SharedMaterial& material,
                                                    bool axisymmetric, const DynamicsSettings<Dim>& settings) {
  RegionBody<Dim> result{deformable_body(mesh, material, 0.0, axisymmetric)};
  SparseRows identity(mesh.num_vertices(), mesh.num_vertices());
  identity.setIdentity();
  for (const std::string& part : loaded_parts(settings))
    if (const auto* facets = facets_of(mesh, part))
      result.surfaces[part] = {.facets = mesh.facets()(Eigen::all, *facets), .functions = identity};
  if (!has_pressure_patches(settings, *material)) result.body.patches.clear();
  for (const auto& part : settings.boundary_velocities)
    if (const auto* facets = facets_of(mesh, part.on)) {
      const std::set<Index> nodes = vertices_of(mesh, *facets);
      result.nodes_on[part.on].assign(nodes.begin(), nodes.end());
    }
  return result;
}

/// Facets with the shape functions of the cloud at their vertices.
template <int Dim>
SurfacePart<Dim> surface_on_cloud(const Approximation<Dim>& cloud, const std::vector<Index>& facets) {
  SurfacePart<Dim> part{.facets = Facets<Dim>(Dim, std::ssize(facets)), .functions = {}};
  std::set<Index> dofs;
  for (std::size_t f = 0; f < facets.size(); ++f)
    for (int i = 0; i < Dim; ++i) {
      const Index dof = cloud.space.facet(facets[f])[i];
      part.facets(i, static_cast<Index>(f)) = dof;
      dofs.insert(dof);
    }
  std::vector<Eigen::Triplet<double, Index>> entries;
  for (const Index dof : dofs) {
    const ShapeRow<Dim> row = cloud.shape.row(dof);
    for (std::size_t k = 0; k < row.nodes.size(); ++k) entries.emplace_back(dof, row.nodes[k], row.N[k]);
  }
  part.functions.resize(cloud.space.size(), cloud.nodes.cols());
  part.functions.setFromTriplets(entries.begin(), entries.end());
  return part;
}

template <int Dim> RegionBody<Dim> body_on_cloud(const FineMesh<Dim>& mesh, const SharedMaterial& material,
                                                 const DynamicsSettings<Dim>& settings, const Monitor& monitor) {
  ApproximationOptions options = settings.common.approximation;
  if (options.support == 0.0) options.support = dynamics_support;
  options.axisymmetric = is_axisymmetric(settings);
  options.dilatation = averaged_if(averages_dilatation(settings, *material));
  options.pressures = PressureKind::constant;
  std::erase_if(options.grading.boundaries, [&](const auto& graded) { return !facets_of(mesh, graded.boundary); });
  // Shape functions of other nodes vanish where velocities are prescribed: there they are those of the nodes.
  for (const auto& part : settings.boundary_velocities)
    if (facets_of(mesh, part.on)) options.vanish_on.push_back(part.on);
  const Approximation<Dim> cloud = approximate(mesh, options, monitor);
  RegionBody<Dim> result{deformable_body(cloud, material, 0.0)};
  for (const auto& part : settings.boundary_velocities)
    if (const auto* facets = facets_of(mesh, part.on)) {
      std::set<Index> dofs;
      for (const Index f : *facets)
        for (const Index dof : cloud.space.facet(f)) dofs.insert(dof);
      for (std::size_t a = 0; a < cloud.node_dofs.size(); ++a)
        if (dofs.contains(cloud.node_dofs[a])) result.nodes_on[part.on].push_back(static_cast<Index>(a));
    }
  for (const std::string& part : loaded_parts(settings))
    if (const auto* facets = facets_of(mesh, part)) result.surfaces[part] = surface_on_cloud(cloud, *facets);
  return result;
}

/// Cells with a vertex on these facets, ascending.
template <int Dim> std::vector<Index> cells_at_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets) {
  const std::set<Index> on = vertices_of(mesh, facets);
  std::vector<Index> result;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (std::ranges::any_of(mesh.cells().col(c), [&](Index vertex) { return on.contains(vertex); }))
      result.push_back(c);
  return result;
}

template <int Dim> RegionBody<Dim> region_on_lattice(const FineMesh<Dim>& mesh, const SharedMaterial& material,
                                                     const DynamicsSettings<Dim>& settings, const MpmOptions& options) {
  const MpmSettings& mpm = settings.mpm;
  double volume = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) volume += mesh.volume(c);
  const double count = mpm.frame == MpmFrame::mesh
                           ? static_cast<double>(mesh.num_cells())
                           : volume / std::pow(options.cell / static_cast<double>(mpm.points_along), Dim);
  require_memory(bytes_per_point * count, fmt::format("a body of {:.3g} material points", count),
                 "take a larger mpm.cell, or fewer mpm.points");
  RegionBody<Dim> result{body_on_lattice<Dim>(mesh, mpm.frame, options, mpm.points_along, material, 0.0)};
  if (!averages_dilatation(settings, *material)) result.body.patches.clear();
  for (const std::string& part : loaded_parts(settings))
    if (const auto* facets = facets_of(mesh, part))
      result.surfaces[part] = surface_on_lattice(mesh, *facets, mpm.frame, options, result.body);
  for (const auto& part : settings.boundary_velocities)
    if (const auto* facets = facets_of(mesh, part.on)) {
      auto near = points_near_facets<Dim>(mesh, *facets, result.body.points, options.cell);
      if (mpm.frame == MpmFrame::mesh) {
        const std::vector<Index> touching = cells_at_facets(mesh, *facets), within = std::exchange(near, {});
        std::ranges::set_union(touching, within, std::back_inserter(near));
      }
      if (mpm.frame == MpmFrame::total)
        result.nodes_on[part.on] = nodes_of_points(result.body, near);
      else
        result.points_on[part.on] = near;
    }
  return result;
}

template <int Dim> RegionBody<Dim> region_of_particles(const FineMesh<Dim>& mesh, const SharedMaterial& material,
                                                       const DynamicsSettings<Dim>& settings,
                                                       const SphOptions& options) {
  double volume = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) volume += mesh.volume(c);
  const double count = volume / std::pow(options.spacing, Dim);
  require_memory(bytes_per_point * count, fmt::format("a body of {:.3g} particles", count),
                 "take a larger sph.spacing");
  RegionBody<Dim> result{particles_on_lattice<Dim>(mesh, settings.sph.frame, options, material, 0.0)};
  for (const auto& part : settings.boundary_velocities)
    if (const auto* facets = facets_of(mesh, part.on))
      result.nodes_on[part.on] = points_near_facets<Dim>(mesh, *facets, result.body.points, options.spacing);
  for (const std::string& part : loaded_parts(settings))
    if (const auto* facets = facets_of(mesh, part))
      result.surfaces[part] = surface_of_particles(mesh, *facets, options, result.body);
  return result;
}

/// The lattice of all bodies begins at a corner of their box.
template <class Options, int Dim> Options with_origin(Options options, const FineMesh<Dim>& mesh) {
  for (int i = 0; i < Dim; ++i) options.origin[static_cast<std::size_t>(i)] = mesh.vertices().row(i).minCoeff();
  return options;
}

template <int Dim>
void set_initial_velocity(const DynamicsSettings<Dim>& settings, const std::string& region, DeformableBody<Dim>& body) {
  const Points<Dim>& at = body.nodes.cols() > 0 ? body.nodes : body.points;
  body.velocity.setZero(Dim, at.cols());
  for (const auto& initial : settings.initial_velocities) {
    if (!initial.region.empty() && initial.region != region) continue;
    for (Index a = 0; a < at.cols(); ++a) {
      const Vec<Dim> v = located(settings.common, initial.where, [&] { return initial.velocity(at.col(a)); });
      if (!v.allFinite())
        throw InputError(
            said_at(initial.where, fmt::format("the velocity at ({:.6g}) is not finite", fmt::join(at.col(a), ", "))));
      body.velocity.col(a) = v;
    }
  }
}

template <int Dim> RegionBody<Dim> build_body(const FineMesh<Dim>& part, const std::string& region,
                                              const SharedMaterial& material, const DynamicsSettings<Dim>& settings,
                                              const FineMesh<Dim>& all, const Monitor& monitor) {
  const auto [where, density] = density_of(settings, region);
  if (!material->finite_strain())
    throw InputError(said_at(where,
                             "the material is for small strains, and bodies in explicit dynamics rotate: take hencky, "
                             "neo_hookean, st_venant_kirchhoff, j2 or another one for finite strains"));
  RegionBody<Dim> result = located(settings.common, settings.common.where, [&] {
    switch (settings.method) {
      case DynamicsMethod::total_lagrangian:
        return body_on_cloud(part, material, settings, monitor);
      case DynamicsMethod::mpm:
        return region_on_lattice(part, material, settings, with_origin(settings.mpm.options, all));
      case DynamicsMethod::sph:
        return region_of_particles(part, material, settings, with_origin(settings.sph.options, all));
      default:
        return body_at_vertices(part, material, is_axisymmetric(settings), settings);
    }
  });
  set_density(density, result.body);
  result.body.strength = strength_of(settings.common, region);
  set_initial_velocity(settings, region, result.body);
  for (const auto& fracture : settings.fractures) {
    if (!fracture.region.empty() && fracture.region != region) continue;
    if (fracture.criteria.strain && !has_plastic_strain(*material))
      throw InputError(said_at(fracture.where,
                               fmt::format("strain is the plastic strain at failure, and the material{} has no plastic "
                                           "strain: expected one such as \"j2\"",
                                           region.empty() ? "" : fmt::format(" of the region \"{}\"", region))));
    result.body.fracture = fracture.criteria;
  }
  return result;
}

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

/// Bodies of a mesh, and what is known of them.
template <int Dim> struct MeshBodies {
  std::vector<RegionBody<Dim>> regions{};
  std::vector<std::string> names{};
  std::vector<std::string> without_inner_nodes{};
  std::vector<double> point_sizes{}, volume_changes{};
};

template <int Dim> MeshBodies<Dim> build_bodies(const PreparedMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings,
                                                const Monitor& monitor) {
  const FineMesh<Dim>& all = *mesh.mesh;
  MeshBodies<Dim> result;
  for (Index r = 0; r < all.num_regions(); ++r) {
    const std::optional<FineMesh<Dim>> extracted = internal::extract_region(all, r);
    if (!extracted) continue;
    const FineMesh<Dim>& part = *extracted;
    result.names.push_back(all.region_names()[r]);
    if (mesh.volume_change.size() > 0) result.volume_changes.push_back(mesh.volume_change[r]);
    result.regions.push_back(build_body(part, result.names.back(), mesh.materials[r], settings, all, monitor));
    const DeformableBody<Dim>& body = result.regions.back().body;
    const auto vertices = std::views::iota(Index{0}, part.num_vertices());
    if (settings.method == DynamicsMethod::otm &&
        std::ranges::all_of(vertices, [&](Index v) { return part.on_boundary(v); }))
      result.without_inner_nodes.push_back(result.names.back());
    for (Index p = 0; p < body.points.cols(); ++p) {
      const double out_of_plane = is_axisymmetric(settings) ? 2.0 * std::numbers::pi * body.points(0, p) : 1.0;
      result.point_sizes.push_back(std::pow(body.volumes[p] / out_of_plane, 1.0 / Dim));
    }
  }
  return result;
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
  MeshBodies<Dim> built = build_bodies(mesh, settings, monitor);
  const Stage stage("bodies", monitor);
  DynamicsOptions options = settings.options;
  options.plane = settings.common.model.plane.value_or(Plane::strain);
  if (lacks_contact(settings)) options.contact.enabled = false;  // there are no surfaces
  options.tied = settings.method == DynamicsMethod::otm && ties_regions(*mesh.mesh, settings);
  const auto num_points = static_cast<Index>(built.point_sizes.size());
  require_memory(bytes_per_point * num_points, fmt::format("explicit dynamics of {} material points", num_points),
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
