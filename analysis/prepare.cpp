// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/prepare.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/prepare_mesh.hpp"
#include "efree/assembly/bodies.hpp"
#include "efree/assembly/nodal_conditions.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/materials/small_and_finite.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <optional>

namespace efree {
namespace {

using internal::boundaries, internal::graded_regions, internal::located, internal::process_cpu_seconds,
    internal::said_at;

/// Whether all probes lie in the body: better known before the analysis than after it. Those beside a curved boundary,
/// between it and its chords, are moved onto these, which is remarked.
template <int Dim>
void check_probes(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, std::vector<std::string>& remarks) {
  const Locator<Dim> locate_probe(mesh, settings.probes.size());
  for (const auto& p : settings.probes) {
    const Location<Dim> there = located(settings.common, p.where, [&] { return locate_probe(p.at); });
    Vec<Dim> found = Vec<Dim>::Zero();
    for (int i = 0; i <= Dim; ++i) found += there.at[i] * mesh.vertex(mesh.cells()(i, there.cell));
    if (const double away = (found - p.at).norm(); away > 1e-6 * mesh.size())
      remarks.push_back(fmt::format("probe \"{}\" lies {:.2g} outside the chords of the boundary: taken at ({:.6g})",
                                    p.name, away, fmt::join(found, ", ")));
  }
}

/// The material of each region. A static analysis takes no fluids.
template <int Dim> std::vector<SharedMaterial> region_materials(const CommonSettings<Dim>& settings, bool is_static,
                                                                const FineMesh<Dim>& mesh) {
  const auto check = [&](const SharedMaterial& material) {  // others are known at their points only
    if (is_static && material && material->homogeneous())
      Materials<Dim>({material}, settings.model.plane.value_or(Plane::strain));
  };
  if (settings.materials.empty()) {
    located(settings, internal::where_said(settings, "material"), [&] { check(settings.model.material); });
    return std::vector<SharedMaterial>(mesh.num_regions(), settings.model.material);
  }
  std::vector<SharedMaterial> materials(mesh.num_regions());
  std::vector<char> given(mesh.num_regions(), 0);
  for (const auto& material : settings.materials) {
    const Index region = located(settings, material.where, [&] {
      check(material.material);
      return mesh.region(material.region);
    });
    materials[region] = material.material;
    given[region] = 1;
  }
  std::vector<std::string> missing;
  for (Index r = 0; r < mesh.num_regions(); ++r)
    if (!given[r]) missing.push_back(mesh.region_names()[r]);
  if (!missing.empty())
    throw InputError(said_at(settings.materials.back().where,
                             fmt::format("no [[material]] for the region \"{}\"; the mesh has \"{}\"",
                                         fmt::join(missing, "\", \""), fmt::join(mesh.region_names(), "\", \""))));
  return materials;
}

/// The density of each region, which forces per mass act on.
template <int Dim> std::vector<Parameter> region_densities(const Settings<Dim>& settings, const FineMesh<Dim>& mesh) {
  const auto cases = loads_by_case(settings);
  const auto asking = std::ranges::find_if(cases, [](const auto& loads) { return !loads.mass_forces.empty(); });
  if (asking == cases.end()) return {};
  std::vector<Parameter> densities(mesh.num_regions(), settings.common.density);
  std::vector<std::string> where(mesh.num_regions(), settings.common.where);
  for (const auto& material : settings.common.materials) {
    densities[mesh.region(material.region)] = material.density;
    where[mesh.region(material.region)] = material.where;
  }
  for (Index r = 0; r < mesh.num_regions(); ++r)
    if (densities[r].is_constant() && !(densities[r].at(Vec<3>::Zero()) > 0.0))
      throw InputError(said_at(
          where[r],
          fmt::format("analysis.{} needs the density of the material{}", asking->mass_forces.front().kind,
                      mesh.num_regions() > 1 ? fmt::format(" of the region \"{}\"", mesh.region_names()[r]) : "")));
  return densities;
}

/// The facets of several of these parts, ascending. Throws InputError for one that is not among them nor in the mesh.
template <int Dim> std::vector<Index> united(const FineMesh<Dim>& mesh,
                                             const std::vector<typename FineMesh<Dim>::Group>& groups,
                                             const std::vector<std::string>& parts) {
  std::vector<Index> all;
  for (const std::string& part : parts) {
    const auto found = std::ranges::find(groups, part, &FineMesh<Dim>::Group::name);
    if (found == groups.end())
      mesh.group(part);
    else
      all.insert(all.end(), found->facets.begin(), found->facets.end());
  }
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

/// The parts of the boundary that have names and do not tie regions to each other, those that the settings select, and
/// one of all slits if there is more than one region.
template <int Dim> FineMesh<Dim> with_parts(const MeshSource<Dim>& source, const CommonSettings<Dim>& settings,
                                            FineMesh<Dim> mesh, std::string& open_interface) {
  using Group = typename FineMesh<Dim>::Group;
  std::vector<Group> groups = mesh.groups();
  if (mesh.num_regions() > 1) {
    Group slits{"\x01slits", {}};  // no name in a file
    for (const Group& group : groups)
      if (std::ranges::find(source.slits, group.name) != source.slits.end())
        slits.facets.insert(slits.facets.end(), group.facets.begin(), group.facets.end());
    if (!slits.facets.empty()) {
      open_interface = slits.name;
      groups.push_back(std::move(slits));
      mesh = std::move(mesh).with_groups(groups);
    }
  }
  const std::vector<TiedFacets> ties = tied_facets(mesh, open_interface);
  if (!ties.empty()) {
    std::vector<char> tied(mesh.num_facets(), 0);
    for (const auto& [first, second] : ties) tied[first] = tied[second] = 1;
    for (Group& group : groups) std::erase_if(group.facets, [&](Index f) { return tied[f]; });
    std::erase_if(groups, [](const Group& group) { return group.facets.empty(); });
  }
  for (const auto& selected : settings.selections)
    located(settings, selected.where, [&] {
      if (std::ranges::find(groups, selected.name, &Group::name) != groups.end())
        throw InputError(
            fmt::format("the mesh has a part named \"{}\", which this selection would be called", selected.name));
      groups.push_back({selected.name, selected.parts.empty() ? select_facets(mesh, selected.how, open_interface)
                                                              : united(mesh, groups, selected.parts)});
      if (groups.back().facets.empty())
        throw InputError(
            fmt::format("the selection \"{}\" is empty: no facet of the boundary, whose vertices lie in "
                        "({:.6g}) to ({:.6g}), belongs to it",
                        selected.name, fmt::join(mesh.vertices().rowwise().minCoeff().eval(), ", "),
                        fmt::join(mesh.vertices().rowwise().maxCoeff().eval(), ", ")));
    });
  return std::move(mesh).with_groups(std::move(groups));
}

/// The mesh with its hinges cut, which is said.
template <int Dim> FineMesh<Dim> without_hinges(FineMesh<Dim> mesh, PreparedMesh<Dim>& result) {
  const Unhinged<Dim> cut = cut_hinges(mesh);
  if (cut.hinges.empty()) return mesh;
  const auto count = static_cast<Index>(cut.hinges.size());
  result.reports.push_back({"hinges_cut", count});
  result.remarks.push_back(
      fmt::format("cells hang together by a vertex or an edge only at {} vert{}, such as ({:.6g}): "
                  "cut there",
                  count, count == 1 ? "ex" : "ices", fmt::join(mesh.vertex(cut.hinges[0]), ", ")));
  return FineMesh<Dim>(cut.mesh);
}

/// The mesh without the bodies that neither the conditions hold nor a load moves, which is said. Where all are free, or
/// one with more than half of the volume, or loaded ones, they stay: the solver refuses them by name.
template <int Dim>
FineMesh<Dim> without_free_bodies(const Settings<Dim>& settings, FineMesh<Dim> mesh, PreparedMesh<Dim>& result) {
  for (const auto& group : boundaries(settings)) located(settings.common, group.where, [&] { mesh.group(group.name); });
  if (mesh.num_components() == 1) return mesh;
  const auto cases = loads_by_case(settings);
  if (std::ranges::any_of(cases, [](const auto& loads) { return loads.inside(); })) return mesh;
  const auto ties = tied_facets(mesh, result.open_interface);
  const Bodies<Dim> bodies = find_bodies(FineSpace<Dim>(mesh, 1, settings.common.model.plane == Plane::axisymmetric),
                                         restraints(settings.supports), ties);
  const auto body_of = [&](Index cell) { return bodies.of_component[mesh.component()[mesh.cells()(0, cell)]]; };
  std::vector<char> out(bodies.size());
  for (Index body = 0; body < bodies.size(); ++body) out[body] = bodies.is_free(body);
  const auto keep_loaded = [&](const std::string& part) {
    for (const Index f : mesh.group(part)) out[body_of(mesh.facet_cell(f))] = 0;
  };
  for (const auto& loads : cases) {
    for (const auto& load : loads.tractions) keep_loaded(load.on);
    for (const auto& load : loads.followers) keep_loaded(load.on);
    for (const auto& load : loads.resultants) keep_loaded(load.on);
  }
  Index count = 0, largest = -1;
  double volume = 0.0;
  for (Index body = 0; body < bodies.size(); ++body) {
    if (!out[body]) continue;
    ++count;
    volume += bodies.volumes[body];
    if (largest < 0 || bodies.volumes[body] > bodies.volumes[largest]) largest = body;
  }
  if (count == 0 || count == bodies.size() || bodies.volumes[largest] > 0.5 * bodies.volumes.sum()) return mesh;
  std::vector<char> kept(mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) kept[c] = !out[body_of(c)];
  const double fraction = volume / bodies.volumes.sum();
  const std::string what =
      fmt::format("{} bod{} with {:.2g} % of the volume", count, count == 1 ? "y" : "ies", 100.0 * fraction);
  result.reports.push_back({"free_bodies", count});
  result.reports.push_back({"free_bodies_fraction", fraction});
  result.remarks.push_back(fmt::format("{} neither held nor loaded and left out, the largest is the {}; {}", what,
                                       describe_body(mesh, bodies, largest),
                                       describe_neighbour(mesh, bodies, largest)));
  FineMesh<Dim> rest(extract(mesh, kept));
  const auto remains = [&](const std::string& name) {
    return std::ranges::find(rest.groups(), name, &FineMesh<Dim>::Group::name) != rest.groups().end();
  };
  for (const auto& group : boundaries(settings))
    if (!remains(group.name))
      throw InputError(said_at(
          group.where, fmt::format("all of the boundary \"{}\" is on bodies that are neither held nor loaded ({}) "
                                   "and left out",
                                   group.name, what)));
  if (!result.open_interface.empty() && !remains(result.open_interface)) result.open_interface.clear();
  return rest;
}

/// As much of a material as is modelled.
SharedMaterial modelled(const SharedMaterial& material, Regime regime) {
  const bool linear = material->linear();
  if (regime == Regime::linear) return linear ? material : SharedMaterial(Linearised(material));
  return linear ? SharedMaterial(GreenElastic(material)) : material;
}

}  // namespace

template <int Dim>
PreparedMesh<Dim> internal::prepare_mesh(const MeshSource<Dim>& source, const CommonSettings<Dim>& settings,
                                         const Settings<Dim>* static_settings, const Monitor& monitor) {
  StageTimes times;
  PreparedMesh<Dim> result;
  const double cpu_start = process_cpu_seconds();
  {
    const Stage stage("mesh", monitor.timing(times));
    std::optional<BoundaryOffsets<Dim>> boundary;
    bool smooth = false;
    FineMesh<Dim> mesh = located(settings, source.where, [&] {
      MadeMesh<Dim> made = source.mesh({mesh_size(source, settings), source.coarsening, source.sagitta}, stage);
      boundary = std::move(made.boundary);
      smooth = made.smooth;
      result.size = made.size;
      result.reports = std::move(made.reports);
      result.remarks = std::move(made.remarks);
      result.warnings = std::move(made.warnings);
      // Functions of moving least squares would smear the strain's jump across an interface; finite elements have it.
      const bool parted = settings.approximation.kind == BasisKind::mls;
      return FineMesh<Dim>(parted ? cut_regions(std::move(made.mesh)) : std::move(made.mesh));
    });
    mesh = without_hinges(std::move(mesh), result);
    mesh = with_parts(source, settings, std::move(mesh), result.open_interface);
    if (static_settings) mesh = without_free_bodies(*static_settings, std::move(mesh), result);
    if (result.size == 0.0) result.size = mesh.size();
    result.surface_is_known = boundary.has_value() && !smooth;
    if (!boundary && smooth) boundary = smooth_offsets(mesh);
    if (boundary) result.offsets = facet_offsets(mesh, *boundary);
    result.mesh = std::make_shared<const FineMesh<Dim>>(std::move(mesh));
  }
  if (monitor.times) monitor.times->add(times);
  result.seconds = times.total();
  result.cpu_seconds = process_cpu_seconds() - cpu_start;
  for (const auto& group : static_settings ? boundaries(*static_settings) : boundaries(settings)) {
    const auto& facets = located(settings, group.where, [&] { return result.mesh->group(group.name); });
    BoundaryPart part{group.name, static_cast<Index>(facets.size()), 0.0};
    for (const Index f : facets) part.measure += result.mesh->facet_measure(f);
    result.remarks.push_back(fmt::format("boundary \"{}\": {} facets, {} {:.6g}", part.name, part.facets,
                                         Dim == 2 ? "length" : "area", part.measure));
    result.parts.push_back(std::move(part));
  }
  for (const auto& region : graded_regions(settings))
    located(settings, region.where, [&] { return result.mesh->region(region.name); });
  result.materials = region_materials(settings, static_settings != nullptr, *result.mesh);
  return result;
}

template <int Dim> double mesh_size(const MeshSource<Dim>& source, const CommonSettings<Dim>& settings) {
  return source.ratio > 0.0 ? settings.approximation.spacing / source.ratio : source.size;
}

template <int Dim>
PreparedMesh<Dim> prepare(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor) {
  PreparedMesh<Dim> result = internal::prepare_mesh(source, settings.common, &settings, monitor);
  result.densities = region_densities(settings, *result.mesh);
  check_probes(settings, *result.mesh, result.remarks);
  return result;
}

/// Whether nodal values can hold all that is held: not the normal displacement of a part that is not flat.
template <int Dim> bool can_hold_strongly(const Settings<Dim>& settings, const PreparedMesh<Dim>& mesh) {
  const FineSpace<Dim> space(mesh.mesh, 1);
  return std::ranges::all_of(restraints(settings.supports), [&](const Restraint<Dim>& restraint) {
    return restraint.is_elastic() || can_be_nodal(space, restraint);
  });
}

template <int Dim> Settings<Dim> with_defaults(Settings<Dim> settings, const PreparedMesh<Dim>& mesh) {
  ElasticModel& model = settings.common.model;
  ApproximationOptions& basis = settings.common.approximation;
  require(settings.regime_tolerance > 0.0, "regime_tolerance: a number > 0 expected");
  if (!settings.regime) {
    const bool linear = std::ranges::all_of(mesh.materials, [](const auto& of) { return of->linear(); });
    settings.regime = linear ? Regime::linear : Regime::automatic;
  }
  if (model.material) model.material = modelled(model.material, *settings.regime);
  model.regions.clear();
  for (const SharedMaterial& material : mesh.materials) model.regions.push_back(modelled(material, *settings.regime));
  model.open_interface = mesh.open_interface;
  settings.loads.density = mesh.densities;  // of all cases
  const auto locks = [&] {
    return incompressibility(model, *mesh.mesh) > bearable_incompressibility(basis.kind) || flows(model);
  };
  if (settings.cases.size() > 1 && settings.regime == Regime::linear && !settings.time &&
      internal::may_do_without_cloud(settings) && internal::has_memory_for_factor_of_quadratic_elements(*mesh.mesh) &&
      !locks())
    basis.kind = BasisKind::p2;
  const bool cloud = basis.kind == BasisKind::mls;
  if (!model.essential)
    model.essential = cloud || !can_hold_strongly(settings, mesh) ? Essential::nitsche : Essential::strong;
  if (cloud && model.essential == Essential::strong)
    for (const auto& support : settings.supports)
      if (!support.stiffness && std::ranges::find(basis.vanish_on, support.on) == basis.vanish_on.end())
        basis.vanish_on.push_back(support.on);
  basis.axisymmetric = model.plane == Plane::axisymmetric;
  basis.fine = basis.fine || model.stabilisation > 0.0;
  if (basis.dilatation == Dilatation::automatic) basis.dilatation = averaged_if(basis.kind != BasisKind::p1 && locks());
  return settings;
}

template Settings<2> with_defaults<2>(Settings<2>, const PreparedMesh<2>&);
template Settings<3> with_defaults<3>(Settings<3>, const PreparedMesh<3>&);
template double mesh_size<2>(const MeshSource<2>&, const CommonSettings<2>&);
template double mesh_size<3>(const MeshSource<3>&, const CommonSettings<3>&);
template PreparedMesh<2> internal::prepare_mesh(const MeshSource<2>&, const CommonSettings<2>&, const Settings<2>*,
                                                const Monitor&);
template PreparedMesh<2> prepare<2>(const MeshSource<2>&, const Settings<2>&, const Monitor&);
template PreparedMesh<3> internal::prepare_mesh(const MeshSource<3>&, const CommonSettings<3>&, const Settings<3>*,
                                                const Monitor&);
template PreparedMesh<3> prepare<3>(const MeshSource<3>&, const Settings<3>&, const Monitor&);

}  // namespace efree
