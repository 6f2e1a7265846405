// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/analyse.hpp"

#include "efree/analysis/internal/clock.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/solvers/reactions.hpp"

#include <fmt/format.h>
#include <optional>

namespace efree {

using namespace internal;

namespace {

/// What holds the body and what loads it, and whether both are in balance.
template <int Dim> void balance(const Settings<Dim>& settings, Result<Dim>& result, bool of_elements) {
  constexpr double rounding = 1e-8;
  const FineSpace<Dim>& space = result.basis().space;
  if (result.cells) {
    if constexpr (Dim == 3) {
      result.part_reactions = result.cells->finest().reactions;
      result.applied = result.cells->applied;
    }
  } else {
    if (result.elements || of_elements)
      result.part_reactions = element_reactions(result.basis(), result.model, settings.supports, settings.loads,
                                                result.solution.coefficients);
    result.applied = applied_loads(space, settings.loads);
  }
  std::vector<Resultant<Dim>> all;
  for (const auto& [part, of] : result.part_reactions) all.push_back(of);
  for (const auto& load : result.applied) all.push_back(load.of);
  const auto& vertices = result.mesh->vertices();
  const double length = (vertices.rowwise().maxCoeff() - vertices.rowwise().minCoeff()).norm();
  result.imbalance = imbalance(all, length, space.axisymmetric());
  if (!(result.imbalance <= rounding))
    result.warnings.push_back(
        fmt::format("reactions and loads are out of balance by {:.2g}, relative: the equations are not solved to "
                    "rounding",
                    result.imbalance));
}

}  // namespace

template <int Dim>
Result<Dim> analyse(const PreparedMesh<Dim>& mesh, const Settings<Dim>& given, const Monitor& watching) {
  const Settings<Dim> settings = with_defaults(given, mesh);
  StageTimes times;
  const Monitor monitor = watching.timing(times);
  Result<Dim> result;
  result.mesh = mesh.mesh;
  result.parts = mesh.parts;
  result.reports = mesh.reports;
  result.model = settings.model;
  const double cpu_start = process_cpu_seconds();
  const bool on_cells = is_on_cells(settings, mesh);
  const bool without_cloud = !on_cells && needs_no_cloud(settings) && has_memory_for_quadratic_elements(*mesh.mesh);
  located(settings, settings.where, [&] {
    if constexpr (Dim == 3)
      if (on_cells) return answer_on_cells(settings, mesh, result, monitor);
    if (without_cloud) return answer_by_elements(settings, result, monitor);
    answer_by_cloud(settings, result, monitor);
  });
  judge(settings, result);
  result.cpu_seconds = mesh.cpu_seconds + process_cpu_seconds() - cpu_start;

  std::optional<Stage> stage(std::in_place, "output", monitor);
  balance(settings, result, without_cloud);
  const Approximation<Dim>& basis = result.basis();
  if (result.fields.displacement.size() == 0) result.fields = recover_fields(basis, result.solution);
  const auto materials = materials_of(result.model, *mesh.mesh);
  if (settings.has_exact()) result.errors = errors_against(basis, result.fields, materials, settings.exact);
  if (result.probes.empty() && result.extremes.empty()) read_off(settings, result);
  if constexpr (Dim == 3)
    if (on_cells)
      result.error_density =
          error_density(result, recovery_errors(*result.cells, result.fields, *mesh.mesh, result.model.regions));
  if (result.error_density.size() == 0)
    result.error_density = error_density(result, recovery_error(basis, result.fields, materials).squares);
  stage.reset();
  result.times.add("mesh", mesh.seconds);
  result.times.add(times);
  if (watching.times) watching.times->add(times);
  return result;
}

template <int Dim>
Result<Dim> analyse(const FineMesh<Dim>& mesh, const Settings<Dim>& settings, const Monitor& monitor) {
  const auto copied = [&mesh](const MeshSize&) {
    return MadeMesh<Dim>{extract(mesh, std::vector<char>(mesh.num_cells(), 1))};
  };
  return analyse<Dim>(MeshSource<Dim>{.mesh = copied, .size = mesh.size()}, settings, monitor);
}

template <int Dim>
Result<Dim> analyse(const MeshSource<Dim>& source, const Settings<Dim>& settings, const Monitor& monitor) {
  if (settings.asks_for_accuracy()) return analyse_to_accuracy(source, settings, monitor);
  const PreparedMesh<Dim> mesh = prepare(source, settings, monitor);
  if (monitor.say)
    for (const std::string& remark : mesh.remarks) monitor.say(remark);
  return analyse(mesh, settings, monitor);
}

template Result<2> analyse<2>(const FineMesh<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const FineMesh<3>&, const Settings<3>&, const Monitor&);
template Result<2> analyse<2>(const PreparedMesh<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const PreparedMesh<3>&, const Settings<3>&, const Monitor&);
template Result<2> analyse<2>(const MeshSource<2>&, const Settings<2>&, const Monitor&);
template Result<3> analyse<3>(const MeshSource<3>&, const Settings<3>&, const Monitor&);

}  // namespace efree
