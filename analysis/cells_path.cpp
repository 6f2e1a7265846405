// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/mentions.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/assembly/bodies.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/memory.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <utility>

namespace efree::internal {
namespace {

/// Why an analysis cannot be solved on cells; empty if it can.
template <int Dim> std::string why_not_on_cells(const Settings<Dim>& settings, const PreparedMesh<Dim>& mesh) {
  if (!mesh.image) return "the geometry is not an image in space on a lattice";
  if (!settings.cases.empty()) return "there are several load cases";
  if (settings.loads.body_force) return "there is a body force";
  if (settings.loads.inside()) return "there is an acceleration or a rotation";
  for (const auto& support : settings.supports)
    if (support.stiffness) return "there is an elastic support";
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
  for (const auto& group : boundaries(settings))
    if (!is_side(group.name)) return fmt::format("\"{}\" is not a side of the image", group.name);
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
  const Stopwatch seconds;
  const bool fixed = mesh.size_is_said, asked = settings.asks_for_accuracy();
  result.approximation.space = space;
  // Fields at the vertices of the mesh, which only carries them, and the errors of what is asked for.
  const auto tell = [&] {
    const Stage stage("output", monitor);
    result.fields = recover_fields(*result.cells, *mesh.image, *mesh.mesh, region_of_label, mesh.materials);
    tell_errors_on_cells(settings, result);
  };
  std::string why = fixed ? mesh_is_said : "";
  for (double size = mesh.size;; size *= 0.5) {
    const double begin = seconds();
    try {
      result.cells = solve_on_cells(*mesh.image, of_label, settings.supports, settings.loads,
                                    {.size = size, .half_voxel = true}, monitor);
    } catch (const NumericalError& failure) {
      if (!result.cells) throw;
      why = fmt::format("a finer grid fails: {}", failure.what());
      break;
    }
    const CellLevel& finest = result.cells->finest();
    const double error = std::hypot(finest.iteration_error, result.cells->grid_error), spent = seconds() - begin;
    result.solution.strain_energy = finest.strain_energy;
    result.estimates = {.cloud = finest.iteration_error,
                        .uncorrected = finest.iteration_error,
                        .mesh = result.cells->grid_error,
                        .corrections = finest.iterations};
    if (!settings.goals.empty()) tell();
    const double missed = missed_goals(settings, result);
    result.attempts.push_back({size, finest.cells, 1, error, spent,
                               std::max(missed, settings.accuracy > 0.0 ? error / settings.accuracy : 0.0)});
    if (error <= bearable_error(settings) && missed <= 1.0) {
      why.clear();
      break;
    }
    // Below its voxels an image says no more: only an answer that would be none is worth the time.
    const double least = (error < settings.largest_error ? 1.0 : 0.5) * mesh.image->spacing.minCoeff();
    if (fixed || (!asked && size < 1.99 * least)) break;
    double points = 8.0;
    for (const Index n : result.cells->grid.cubes) points *= n + 1.0;
    if (cell_memory * points > 0.5 * available_memory()) {
      why = "a finer grid would take more memory than there is";
      break;
    }
    if (seconds() + 9.0 * spent > settings.time_limit) {
      why = fmt::format("a finer grid would take about {:.3g} s, and the time limit is {:.3g} s", 9.0 * spent,
                        settings.time_limit);
      break;
    }
  }
  if (asked && !why.empty()) warn_of_misses(settings, why, result);
  if (settings.goals.empty()) tell();
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
