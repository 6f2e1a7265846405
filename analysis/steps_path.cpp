// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/locking.hpp"
#include "efree/solvers/nonlinear_equilibrium.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>

namespace efree::internal {
namespace {

template <int Dim> Program<Dim> program_of(const Settings<Dim>& settings) {
  if (!settings.time || !settings.time->acting)
    return Program<Dim>::grows(settings.supports, settings.loads, settings.time ? settings.time->path.end : 1.0);
  const auto acting = settings.time->acting;
  return {[acting](double time) { return acting(time).supports; },
          [acting, density = settings.loads.density](double time) {
            Loads<Dim> loads = acting(time).loads;
            loads.density = density;
            return loads;
          }};
}

/// Strains and stresses of a state where they live.
template <int Dim> Solution<Dim> solution_of(const NonlinearEquilibrium<Dim>& equations, const State& state) {
  const auto& approximation = equations.approximation();
  PointFields<Dim> points = equations.fields(state);
  return {state.u.reshaped(Dim, approximation.shape.num_nodes()), std::move(points.strain), std::move(points.stress),
          approximation.quadrature.weights.dot(points.energy)};
}

}  // namespace

template <int Dim> bool needs_steps(const Settings<Dim>& settings, const FineMesh<Dim>& mesh) {
  return settings.time.has_value() || !materials_of(settings.model, mesh).linear();
}

template <int Dim> void answer_by_steps(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (settings.asks_for_accuracy())
    throw InputError("an accuracy can be asked for where materials are linear and nothing changes with time");
  if (!settings.cases.empty())
    throw InputError("load cases share one matrix: materials have to be linear, and nothing may change with time");
  ApproximationOptions options = settings.approximation;
  if (options.kind == BasisKind::mls && options.spacing == 0.0) options.spacing = default_spacing(*result.mesh);
  require_memory(least_memory(options, *result.mesh),
                 fmt::format("the analysis on {} fine cells", result.mesh->num_cells()),
                 "use a wider cloud spacing or a coarser mesh");
  result.approximation = approximate(result.mesh, options, monitor);
  const NonlinearEquilibrium<Dim> equations(result.approximation, result.model, program_of(settings));
  const FineSpace<Dim>& space = result.approximation.space;
  const Locator<Dim> locator(space.mesh(), settings.probes.size());
  std::vector<Location<Dim>> places;
  for (const auto& probe : settings.probes) places.push_back(locator(probe.at));
  State last = equations.rest();
  const auto converged = [&](const PathStep& step) {
    const State& state = step.now.state;
    HistoryStep<Dim> row{state.time,
                         step.now.iterations(),
                         step.now.residuals.back(),
                         0.0,
                         result.history.empty() ? 0.0 : result.history.back().dissipated,
                         equations.smallest_jacobian(state),
                         0.0,
                         step.now.negative_pivots,
                         equations.reactions(state),
                         {}};
    const PointFields<Dim> points = equations.fields(state);
    const Vector& weights = result.approximation.quadrature.weights;
    row.stored = weights.dot(points.energy);
    row.dissipated += weights.dot(points.dissipated);
    row.plastic_share = (points.dissipated.array() > 0.0).select(weights, 0.0).sum() / weights.sum();
    const Points<Dim> u =
        interpolate(result.approximation.shape, Points<Dim>(state.u.reshaped(Dim, result.approximation.nodes.cols())));
    for (const auto& place : places) {
      const auto N = space.values(place.at);
      const auto dofs = space.cell(place.cell);
      Vec<Dim> value = Vec<Dim>::Zero();
      for (std::size_t i = 0; i < dofs.size(); ++i) value += N[i] * u.col(dofs[i]);
      row.probes.push_back(value);
    }
    if (row.negative_pivots > 0 && (result.history.empty() || result.history.back().negative_pivots == 0))
      result.warnings.push_back(fmt::format("at time {:.6g} the body is not stable: its energy falls in {} direction{}",
                                            row.time, row.negative_pivots, row.negative_pivots == 1 ? "" : "s"));
    result.history.push_back(std::move(row));
    last = state;
  };
  Cholesky linear;
  try {
    follow(equations, linear, equations.rest(), settings.time ? settings.time->path : PathOptions{}, converged,
           monitor);
  } catch (const PathError& error) {
    if (result.history.empty()) throw;
    result.stopped = error.what();
    result.refusal = error.what();
  }
  result.solution = solution_of(equations, last);
  result.balance = {result.history.back().reactions, equations.applied(last)};
  result.fields = recover_fields(result.approximation, result.solution);
  if (options.kind == BasisKind::p1 &&
      (flows(result.model) || incompressibility(result.model, *result.mesh) > bearable_incompressibility(options.kind)))
    result.warnings.push_back(
        "linear elements lock where materials flow or are nearly incompressible (nu > 0.4): the body is far stiffer "
        "than "
        "it should be; take moving least squares, or quadratic elements");
  const auto doubtful = doubts(settings.approximation, result.approximation);
  result.warnings.insert(result.warnings.end(), doubtful.begin(), doubtful.end());
  result.warnings.push_back(
      "how far the answer of materials that are not linear is from the truth is not estimated: compare clouds and "
      "meshes of two sizes");
}

template bool needs_steps<2>(const Settings<2>&, const FineMesh<2>&);
template bool needs_steps<3>(const Settings<3>&, const FineMesh<3>&);
template void answer_by_steps<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_steps<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
