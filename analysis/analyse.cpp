// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/analyse.hpp"

#include "efree/analysis/internal/clock.hpp"
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/told_errors.hpp"
#include "efree/core/error.hpp"

#include <cmath>
#include <optional>

namespace efree {

using namespace internal;

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
  const Approximation<Dim>& basis = result.basis();
  if (result.fields.displacement.size() == 0) result.fields = recover_fields(basis, result.solution);
  if (!(result.fields.displacement.allFinite() && result.fields.stress.allFinite() &&
        std::isfinite(result.solution.strain_energy)))
    throw NumericalError("the answer is not finite: moduli, loads or lengths leave the range of double precision");
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
