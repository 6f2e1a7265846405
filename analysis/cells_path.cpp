// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/grid_search.hpp"
#include "efree/analysis/internal/image_parts.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/assembly/bodies.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// Why an analysis cannot be solved on cells; empty if it can.
template <int Dim> std::string why_not_on_cells(const Settings<Dim>& settings, const PreparedMesh<Dim>& mesh) {
  if (!mesh.image) return "the geometry is not an image in space on a lattice";
  if (!settings.cases.empty()) return "there are several load cases";
  if (settings.loads.body_force) return "there is a body force";
  if (settings.loads.inside()) return "there is an acceleration or a rotation";
  if (!settings.loads.followers.empty()) return "a pressure follows the boundary";
  if (settings.has_exact()) return "there is an exact solution to compare with";
  if (mesh.open_interface.size() > 0) return "regions are open along a part";
  std::vector<char> seen(mesh.materials.size(), 0);
  for (Index c = 0; c < mesh.mesh->num_cells(); ++c) {
    const Index region = mesh.mesh->region(c);
    if (std::exchange(seen[region], 1)) continue;
    Vec<3> there = Vec<3>::Zero();
    there.head<Dim>() = mesh.mesh->centroid(c);
    if (!is_isotropic(mesh.materials[region], there)) return "a material is not isotropic";
  }
  ElasticModel model = settings.common.model;
  model.regions = mesh.materials;
  if (incompressibility(model, *mesh.mesh) > bearable_incompressibility(BasisKind::mls))
    return "a material is nearly incompressible";
  return "";
}

}  // namespace

void answer_on_cells(const Settings<3>& settings, const PreparedMesh<3>& mesh, Result<3>& result,
                     const Monitor& monitor) {
  const FineSpace<3> space(*mesh.mesh, 1);
  require_restrained(space, restraints(settings.supports), tied_facets(*mesh.mesh, mesh.open_interface));
  std::vector<SharedMaterial> of_label(mesh.region_of_label.rbegin()->first + 1);
  std::vector<Index> region_of_label(of_label.size(), -1);
  for (const auto& [label, name] : mesh.region_of_label) {
    const auto& names = mesh.mesh->region_names();
    const auto found = std::ranges::find(names, name);
    if (found != names.end()) region_of_label[label] = static_cast<Index>(found - names.begin());
    const auto material = std::ranges::find(settings.common.materials, name, &RegionMaterial::region);
    if (settings.common.materials.empty())
      of_label[label] = settings.common.model.material;
    else if (material == settings.common.materials.end())
      throw InputError(
          said_at(settings.common.materials.back().where, fmt::format("no [[material]] for the region \"{}\"", name)));
    else
      of_label[label] = material->material;
  }
  result.approximation.space = space;
  // Fields at the vertices of the mesh, which only carries them, and the errors of what is asked for.
  const auto tell = [&] {
    const Stage stage("output", monitor);
    result.fields = recover_fields(*result.cells, *mesh.image, *mesh.mesh, region_of_label, mesh.materials);
    read_off<3>(settings, result.basis().space, result);
    tell_errors_on_cells(settings, *result.cells, result);
  };
  const auto take = [&](std::vector<CellSolution> solutions) {
    result.cells = std::move(solutions.front());
    result.solution.strain_energy = result.cells->finest().strain_energy;
    result.estimates = estimates_on_cells(*result.cells);
  };
  search_grid(
      settings,
      {*mesh.image, of_label, image_parts(settings, *mesh.image), {settings.loads}, mesh.size, mesh.size_is_said}, take,
      tell, result, monitor);
}

template <int Dim> bool is_on_cells(const Settings<Dim>& settings, const PreparedMesh<Dim>& mesh) {
  if (Dim == 2 || settings.cells == OnCells::never) return false;
  const std::string why = why_not_on_cells(settings, mesh);
  if (settings.cells == OnCells::always && !why.empty())
    throw InputError(said_at(where_said(settings.common, "basis.kind"),
                             fmt::format("basis.kind = \"cells\" does not do here: {}", why)));
  return why.empty();
}

template bool is_on_cells<2>(const Settings<2>&, const PreparedMesh<2>&);
template bool is_on_cells<3>(const Settings<3>&, const PreparedMesh<3>&);

}  // namespace efree::internal
