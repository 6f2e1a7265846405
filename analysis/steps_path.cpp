// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/memory.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/materials/plasticity.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/locking.hpp"
#include "efree/solvers/nonlinear_equilibrium.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <map>

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

template <class Test> bool materials_all(const ElasticModel& model, const Test& test) {
  if (model.regions.empty()) return test(*model.material);
  return std::ranges::all_of(model.regions, [&](const SharedMaterial& material) { return test(*material); });
}

bool softens(const ElasticModel& model) {
  return !materials_all(model, [](const Material& material) {
    const auto* plastic = dynamic_cast<const Plastic*>(&material);
    return plastic == nullptr || !plastic->softens();
  });
}

/// The largest displacement gradient that a material of small strains sees.
template <int Dim> double largest_of_small(const NonlinearEquilibrium<Dim>& equations, const PointFields<Dim>& points) {
  const auto& quadrature = equations.approximation().quadrature;
  double largest = 0.0;
  for (Index K = 0; K < quadrature.size(); ++K)
    if (!equations.materials().finite_strain(quadrature.region[K]))
      largest = std::max(largest, (points.F.col(K) - trace_direction<Dim>()).norm());
  return largest;
}

/// What materials remember at the quadrature points, by name.
template <int Dim> std::map<std::string, Matrix> remembered(const NonlinearEquilibrium<Dim>& equations,
                                                            const ElasticModel& model, const Vector& history) {
  const auto& points = equations.approximation().quadrature;
  const auto places = equations.materials().history_places(points);
  std::map<std::string, Matrix> all;
  for (Index K = 0; K < points.size(); ++K) {
    const SharedMaterial& material = model.regions.empty() ? model.material : model.regions[points.region[K]];
    for (const auto& [name, offset, size] : material->history_parts()) {
      Matrix& values = all.try_emplace(name, Matrix::Zero(size, points.size())).first->second;
      values.col(K) = history.segment(places[K] + offset, size);
    }
  }
  return all;
}

/// Values at the quadrature points as stresses are recovered; what is nowhere negative there does not become so.
template <int Dim>
Matrix recovered(const Approximation<Dim>& approximation, const Matrix& values, const RecoveryFits<Dim>& fits) {
  Matrix result(values.rows(), approximation.space.num_places());
  for (Index first = 0; first < values.rows(); first += voigt_size<Dim>) {
    const Index rows = std::min<Index>(voigt_size<Dim>, static_cast<Index>(values.rows()) - first);
    Solution<Dim> packed;
    packed.coefficients = Points<Dim>::Zero(Dim, approximation.shape.num_nodes());
    packed.strain = packed.stress = VoigtPoints<Dim>::Zero(voigt_size<Dim>, values.cols());
    packed.stress.topRows(rows) = values.middleRows(first, rows);
    result.middleRows(first, rows) = recover_fields(approximation, packed, fits).stress.topRows(rows);
  }
  for (Index row = 0; row < values.rows(); ++row)
    if (values.row(row).minCoeff() >= 0.0) result.row(row) = result.row(row).cwiseMax(0.0);
  return result;
}

/// Strains and stresses where they live.
template <int Dim>
Solution<Dim> solution_of(const NonlinearEquilibrium<Dim>& equations, const State& state, PointFields<Dim>& points) {
  const auto& approximation = equations.approximation();
  return {state.u.reshaped(Dim, approximation.shape.num_nodes()), std::move(points.strain), std::move(points.stress),
          approximation.quadrature.weights.dot(points.energy)};
}

/// Says where the path becomes unstable. Pivots are those of the symmetric part, which may be negative before the whole
/// is singular: where pressures that follow the body end at parts that are weakly held.
template <int Dim> void warn_of_instability(Result<Dim>& result) {
  const bool follows =
      std::ranges::any_of(result.balance.loads, [](const auto& load) { return load.kind == "follower_pressure"; });
  Index before = 0;
  for (const HistoryStep<Dim>& step : result.history) {
    if (step.negative_pivots > 0 && before == 0)
      result.warnings.push_back(fmt::format(
          "at time {:.6g} the body {} not stable: its energy falls in {} direction{}{}", step.time,
          follows ? "may be" : "is", step.negative_pivots, step.negative_pivots == 1 ? "" : "s",
          follows ? " of the symmetric part of its stiffness (pressures that follow the body have one that is not "
                    "symmetric where they end)"
                  : ""));
    before = step.negative_pivots;
  }
}

/// Tells a body and its functions from others.
template <int Dim> std::uint64_t fingerprint(const Approximation<Dim>& approximation) {
  return Fingerprint()
      .add(approximation.space.mesh().vertices())
      .add(approximation.nodes)
      .add(approximation.quadrature.points)
      .add(approximation.quadrature.weights)
      .value();
}

/// Where the steps begin: at rest, or where others have come to.
template <int Dim>
Checkpoint<Dim> beginning(const Settings<Dim>& settings, const NonlinearEquilibrium<Dim>& equations) {
  Checkpoint<Dim> there{equations.rest(), {}, fingerprint(equations.approximation())};
  if (!settings.steps.from) return there;
  const Checkpoint<Dim>& from = *settings.steps.from;
  if (from.body != there.body || from.at.u.size() != there.at.u.size() ||
      from.at.history.size() != there.at.history.size())
    throw InputError(
        "these steps cannot be gone on with: they are of another mesh, other nodes or other quadrature points");
  return from;
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
  Checkpoint<Dim> there = beginning(settings, equations);
  auto& history = there.history;
  std::optional<RecoveryFits<Dim>> fits;
  /// Fields of a state, into the result.
  const auto recover = [&](const State& state) {
    if (!fits) fits = recovery_fits(result.approximation);
    PointFields<Dim> points = equations.fields(state);
    result.solution = solution_of(equations, state, points);
    result.fields = recover_fields(result.approximation, result.solution, *fits);
    result.remembered.clear();
    for (const auto& [name, values] : remembered(equations, result.model, points.history))
      result.remembered.emplace_back(name, recovered(result.approximation, values, *fits));
  };
  int recovered_at = 0;
  bool telling = false;
  const auto converged = [&](const PathStep& step) {
    const State& state = step.now.state;
    const double smallest = equations.smallest_jacobian(state);
    if (equations.finite_strain() && !(smallest > 0.0))  // small strains know no J
      throw PathError(
          fmt::format("at time {:.6g} the body is turned inside out somewhere (J = {:.3g}): what follows is "
                      "no answer",
                      state.time, smallest),
          step.before.time, there.at.steps);
    HistoryStep<Dim> row{state.time,
                         step.now.iterations(),
                         step.now.residuals.back(),
                         0.0,
                         history.empty() ? 0.0 : history.back().dissipated,
                         smallest,
                         0.0,
                         step.now.negative_pivots,
                         equations.reactions(state),
                         {}};
    Resultants<Dim> named;  // the name may be that of another part
    for (const Reaction& reaction : settings.reactions) named[reaction.name] = row.reactions.at(reaction.on);
    for (const auto& [name, of] : named) row.reactions[name] = of;
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
    history.push_back(std::move(row));
    there.at = step.after;
    static_cast<State&>(there.at) = state;
    if (!settings.steps.done) return;
    if (settings.steps.fields_every > 0 && there.at.steps % settings.steps.fields_every == 0) {
      recover(state);
      recovered_at = there.at.steps;
    } else {
      result.fields = {};
    }
    telling = true;
    settings.steps.done(there, result);
    telling = false;
  };
  const bool symmetric = materials_all(result.model, [](const Material& material) { return material.symmetric(); });
  const auto stopped = [&](std::string why) {
    if (!symmetric)
      why +=
          "; flow that is not associated has an unsymmetric tangent, of which the symmetric part is taken: take a "
          "dilatancy nearer to the friction";
    if (history.empty()) throw NumericalError(why);
    result.stopped = result.refusal = why;
  };
  Cholesky linear;
  try {
    PathPoint from = there.at;
    if (from.steps > 0) static_cast<State&>(from) = equations.commit(from);
    follow(equations, linear, std::move(from), settings.time ? settings.time->path : PathOptions{}, converged, monitor);
  } catch (const PathError& error) {
    stopped(error.what());
  } catch (const InputError& error) {  // an expression that is not finite at some time
    if (history.empty() || telling) throw;
    stopped(error.what());
  }
  if (recovered_at != there.at.steps || result.fields.displacement.size() == 0) recover(there.at);
  result.history = std::move(history);
  result.balance = {equations.reactions(there.at), equations.applied(there.at)};
  warn_of_instability(result);
  if (options.kind == BasisKind::p1 &&
      (flows(result.model) || incompressibility(result.model, *result.mesh) > bearable_incompressibility(options.kind)))
    result.warnings.push_back(
        "linear elements lock where materials flow or are nearly incompressible (nu > 0.4): the body is far stiffer "
        "than "
        "it should be; take moving least squares, or quadratic elements");
  const auto doubtful = doubts(settings.approximation, result.approximation);
  result.warnings.insert(result.warnings.end(), doubtful.begin(), doubtful.end());
  if (equations.finite_strain())
    for (const auto& load : result.balance.loads)
      if (load.kind == "pressure")
        result.warnings.push_back(
            fmt::format("pressure on \"{}\" acts on the area and along the normal at rest: it does not follow the "
                        "body, as it would with follower = true",
                        load.on));
  if (settings.model.plane == Plane::stress)
    for (const auto& load : result.balance.loads)
      if (load.kind == "follower_pressure")
        result.warnings.push_back(fmt::format(
            "pressure on \"{}\" follows the body in its plane: it is per thickness at rest, not as it is", load.on));
  if (const double strain = largest_of_small(equations, equations.fields(there.at)); strain > 0.05)
    result.warnings.push_back(
        fmt::format("a material of small strains has displacement gradients of {:.2g}: take one of finite strains "
                    "(strain = \"finite\", or a hyperelastic model)",
                    strain));
  if (result.history.back().dissipated > 0.0 && softens(result.model))
    result.warnings.push_back(
        "a material softens: strains localise in bands a few spacings of the cloud wide, and what tearing dissipates "
        "changes with the spacing (measured: up to twofold); compare clouds of several spacings");
  result.warnings.push_back(
      "how far the answer of materials that are not linear is from the truth is not estimated: compare clouds and "
      "meshes of two sizes");
}

template bool needs_steps<2>(const Settings<2>&, const FineMesh<2>&);
template bool needs_steps<3>(const Settings<3>&, const FineMesh<3>&);
template void answer_by_steps<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_steps<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
