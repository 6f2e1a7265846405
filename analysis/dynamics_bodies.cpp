// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of explicit dynamics from the regions of a mesh, by the functions and points of each method.
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/region_body.hpp"
#include "efree/analysis/internal/resolutions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/mesh/internal/extract_region.hpp"
#include "efree/materials/equation_of_state.hpp"
#include "efree/materials/rankine.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <ranges>
#include <set>
#include <utility>

namespace efree::internal {
namespace {

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

}  // namespace

template <int Dim> MeshBodies<Dim> build_bodies(const PreparedMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings,
                                                const Monitor& monitor) {
  const FineMesh<Dim>& all = *mesh.mesh;
  MeshBodies<Dim> result;
  for (Index r = 0; r < all.num_regions(); ++r) {
    const std::optional<FineMesh<Dim>> extracted = extract_region(all, r);
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

template MeshBodies<2> build_bodies(const PreparedMesh<2>&, const DynamicsSettings<2>&, const Monitor&);
template MeshBodies<3> build_bodies(const PreparedMesh<3>&, const DynamicsSettings<3>&, const Monitor&);

}  // namespace efree::internal
