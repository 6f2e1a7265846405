// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/linear_check.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/cholesky.hpp"
#include "efree/solvers/locking.hpp"
#include "efree/solvers/nonlinear_equilibrium.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <map>
#include <memory>
#include <optional>

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

/// Where the full model goes on, and how.
struct Agreement {
  State state;
  PathOptions rest;
};

/// Follows the path by linear elasticity as long as that is enough, checking every step. Nothing if it comes to the
/// end; else the last step at which both models agreed to rounding, or the beginning, and the history up to there: what
/// follows is the full model's, whatever the tolerance.
template <int Dim, class Record> std::optional<Agreement> follow_linear(LinearBeside<Dim>& beside,
                                                                        const PathOptions& path, const Record& record,
                                                                        Result<Dim>& result, const Monitor& monitor) {
  struct NotEnough {};
  Agreement last{beside.taken_over(beside.equations().rest()), path};
  std::size_t agreed = 0;  // steps
  std::string why;
  Cholesky factor;
  try {
    follow(
        beside.equations(), factor, beside.equations().rest(), path,
        [&](const PathStep& step) {
          result.linear_checks.push_back(beside(step.now.state));
          if (!result.linear_checks.back().enough) throw NotEnough{};
          record(beside.equations(), step);
          if (!result.linear_checks.back().same || agreed + 1 < result.history.size()) return;
          last.state = beside.taken_over(step.now.state);
          last.rest.step = step.next;
          agreed = result.history.size();
        },
        monitor);
    if (monitor.say) {
      const auto worst = std::ranges::max_element(result.linear_checks, {}, [](const LinearCheck& check) {
        return std::max(check.displacement, check.stress);
      });
      monitor.say(fmt::format("model: linear elasticity is enough at all {} steps, most {}",
                              result.linear_checks.size(), text_of(*worst)));
    }
    return std::nullopt;
  } catch (const NotEnough&) {
    const LinearCheck& check = result.linear_checks.back();
    why = fmt::format("at time {:.6g} linear elasticity is not enough, {}", check.time, text_of(check));
  } catch (const PathError& error) {
    why = fmt::format("linear elasticity ends, {}", error.what());
  }
  result.history.resize(agreed);
  last.rest.min_step = path.min_step > 0.0 ? path.min_step : 1e-3 * path.step;
  last.rest.max_step = path.max_step > 0.0 ? path.max_step : std::max(path.step, 0.1 * path.end);
  last.rest.max_steps -= static_cast<int>(agreed);
  if (monitor.say)
    monitor.say(fmt::format("model: {}; the full model is taken from {}", why,
                            agreed == 0
                                ? "the beginning"
                                : fmt::format("time {:.6g}, up to which both agree to rounding", last.state.time)));
  return last;
}

}  // namespace

template <int Dim> bool needs_steps(const Settings<Dim>& settings, const FineMesh<Dim>& mesh) {
  return settings.time.has_value() || !materials_of(settings.model, mesh).linear();
}

template <int Dim> void answer_by_steps(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (settings.asks_for_accuracy())
    throw InputError(
        "an accuracy can be asked for where materials are linear (analysis.model = \"linear\" takes them so) and "
        "nothing changes with time");
  if (!settings.cases.empty())
    throw InputError(
        "load cases share one matrix: materials have to be linear (analysis.model = \"linear\" takes them so), and "
        "nothing may change with time");
  const ApproximationOptions& options = settings.approximation;
  approximate_once(settings, result, monitor);
  const NonlinearEquilibrium<Dim> full(result.approximation, result.model, program_of(settings));
  const FineSpace<Dim>& space = result.approximation.space;
  const Locator<Dim> locator(space.mesh(), settings.probes.size());
  std::vector<Location<Dim>> places;
  for (const auto& probe : settings.probes) places.push_back(locator(probe.at));
  State last = full.rest();
  const auto record = [&](const NonlinearEquilibrium<Dim>& equations, const PathStep& step) {
    const State& state = step.now.state;
    const double smallest = equations.smallest_jacobian(state);
    if (!(smallest > 0.0))
      throw PathError(
          fmt::format("at time {:.6g} the body is turned inside out somewhere (J = {:.3g}): what follows is "
                      "no answer",
                      state.time, smallest),
          result.history.empty() ? 0.0 : result.history.back().time, static_cast<int>(result.history.size()));
    HistoryStep<Dim> row{state.time,
                         step.now.iterations(),
                         step.now.residuals.back(),
                         0.0,
                         result.history.empty() ? 0.0 : result.history.back().dissipated,
                         smallest,
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
  const bool symmetric = materials_all(result.model, [](const Material& material) { return material.symmetric(); });
  const auto stopped = [&](std::string why) {
    if (!symmetric)
      why +=
          "; flow that is not associated has an unsymmetric tangent, of which the symmetric part is taken: take a "
          "dilatancy nearer to the friction";
    if (result.history.empty()) throw NumericalError(why);
    result.stopped = result.refusal = why;
  };
  PathOptions path = settings.time ? settings.time->path : PathOptions{};
  State start = full.rest();
  std::unique_ptr<LinearBeside<Dim>> beside;  // as long as linear elasticity is enough
  if (settings.regime == Regime::automatic && path.control == Control::load) {
    beside = std::make_unique<LinearBeside<Dim>>(full, settings.regime_tolerance);
    if (const std::optional<Agreement> until = follow_linear(*beside, path, record, result, monitor)) {
      last = start = until->state;
      path = until->rest;
      beside.reset();
    } else {
      result.model = beside->equations().model();
    }
  } else if (settings.regime == Regime::automatic && monitor.say) {
    monitor.say("model: by arc length, which is for limit points, the full model is taken");
  }
  const NonlinearEquilibrium<Dim>& equations = beside ? beside->equations() : full;
  result.regime = beside ? Regime::linear : Regime::finite;
  Cholesky factor;
  try {
    if (!beside)
      follow(
          full, factor, start, path, [&](const PathStep& step) { record(full, step); }, monitor);
  } catch (const PathError& error) {
    stopped(error.what());
  } catch (const InputError& error) {  // an expression that is not finite at some time
    if (result.history.empty()) throw;
    stopped(error.what());
  }
  PointFields<Dim> points = equations.fields(last);
  result.solution = solution_of(equations, last, points);
  result.balance = {result.history.back().reactions, equations.applied(last)};
  const RecoveryFits<Dim> fits = recovery_fits(result.approximation);
  result.fields = recover_fields(result.approximation, result.solution, fits);
  for (const auto& [name, values] : remembered(equations, result.model, points.history))
    result.remembered.emplace_back(name, recovered(result.approximation, values, fits));
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
        result.warnings.push_back(fmt::format(
            "pressure on \"{}\" acts on the area and along the normal at rest: it does not follow the body", load.on));
  if (const double strain = largest_of_small(equations, points); strain > 0.05)
    result.warnings.push_back(
        fmt::format("a material of small strains has displacement gradients of {:.2g}: take one of finite strains "
                    "(strain = \"finite\", or a hyperelastic model)",
                    strain));
  result.warnings.push_back(
      "how far the answer of materials that are not linear is from the truth is not estimated: compare clouds and "
      "meshes of two sizes");
}

template bool needs_steps<2>(const Settings<2>&, const FineMesh<2>&);
template bool needs_steps<3>(const Settings<3>&, const FineMesh<3>&);
template void answer_by_steps<2>(const Settings<2>&, Result<2>&, const Monitor&);
template void answer_by_steps<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
