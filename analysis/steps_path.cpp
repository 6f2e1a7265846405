// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/linear_check.hpp"
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/path_end.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/assembly/follower_pressure.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/fingerprint.hpp"
#include "efree/core/internal/setting_error.hpp"
#include "efree/solvers/algorithms/modes.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"
#include "efree/solvers/linear/hybrid_solver.hpp"

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

/// What materials remember at the quadrature points, by name.
template <int Dim>
std::map<std::string, Matrix> remembered(const NonlinearEquilibrium<Dim>& equations, const Vector& history) {
  const ElasticModel& model = equations.model();
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

/// An analysis on its way through time: by linear elasticity as long as that is enough, if the settings leave that
/// open, and by the full model.
template <int Dim> class Walk {
 public:
  /// At rest, or where others have come to. Refers to all.
  Walk(const Settings<Dim>& settings, const NonlinearEquilibrium<Dim>& full, Result<Dim>& result,
       const Monitor& monitor)
      : settings_(settings), full_(full), result_(result), monitor_(monitor), locator_(mesh(), settings.probes.size()) {
    if (settings.time) path_ = settings.time->path;
    if (path_.control == Control::load) add_stops();
    if (settings.time && settings.time->until) end_.emplace(settings, *settings.time->until);
    for (const auto& probe : settings.probes) places_.push_back(locator_(probe.at));
    begin();
  }

  /// Comes to the end, or to where it cannot go on: result.stopped.
  void go() {
    if (end_ && end_->is_passed(there_.history)) return;  // by an earlier run
    if (end_ || path_.control == Control::arc_length)
      path_.until = [this, more = path_.until](const PathStep& step) { return is_end() || (more && more(step)); };
    if (there_.agreed) {
      if (const std::string why = not_linear(); !why.empty()) take_over(why);
    } else if (settings_.regime == Regime::automatic && path_.control == Control::arc_length && monitor_.say) {
      monitor_.say("model: by arc length, which is for limit points, the full model is taken");
    }
    if (!there_.agreed) follow_full();
    if (end_ && result_.stopped.empty() && !end_->is_passed(there_.history))
      result_.warnings.push_back(fmt::format(
          "the path is at its end, t = {:.6g}, before {}: it is {:.6g} there; a later time.end lets it go on",
          there_.at.time, text_of(settings_.time->until.value()), end_->value(there_.history.back())));
  }

  /// The model that goes on, or did to the end.
  const NonlinearEquilibrium<Dim>& equations() const { return there_.agreed ? beside_->equations() : full_; }
  /// Where it is, of these equations.
  const State& at() const { return there_.at; }

  /// All into the result that says how it came here.
  void finish() {
    if (recovered_at_ != there_.at.steps || result_.fields.displacement.size() == 0) recover();
    result_.history = std::move(there_.history);
    if (there_.mode.size() > 0) {
      const auto& shape = full_.approximation().shape;
      result_.instability = interpolate(shape, Points<Dim>(there_.mode.reshaped(Dim, shape.num_nodes())));
      result_.instability /= result_.instability.cwiseAbs().maxCoeff();
    }
    result_.model = equations().model();
    if (settings_.regime != Regime::automatic) return;
    result_.regime = there_.agreed ? Regime::linear : Regime::finite;
    result_.linear_checks = std::move(there_.linear_checks);
  }

 private:
  const FineMesh<Dim>& mesh() const { return full_.approximation().space.mesh(); }

  /// Stops where a coarser path has steps, and where loads turn.
  void add_stops() {
    std::vector<double>& stops = path_.stops;
    if (settings_.steps.coarser) {
      const std::vector<double> times = times_of(*settings_.steps.coarser);
      stops.insert(stops.end(), times.begin(), times.end());
    }
    stops = stops_at_turns(settings_, mesh(), std::move(stops));
  }

  void note_steps() {
    there_.scale = path_.scale;
    if (settings_.time) there_.elastic_range = settings_.time->elastic_range;
  }

  void begin() {
    const std::uint64_t body = fingerprint(full_.approximation());
    const auto& steps = settings_.steps;
    const bool another = steps.from && steps.from_another && steps.from->body != body;
    is_told_ = steps.done && !another;
    const auto from = another ? std::nullopt : steps.from;
    if (from ? from->agreed.has_value() : settings_.regime == Regime::automatic && path_.control == Control::load)
      beside_ = std::make_unique<LinearBeside<Dim>>(full_, settings_.regime_tolerance);
    const PathPoint rest = beside_ ? beside_->equations().rest() : full_.rest();
    if (!from) {
      there_ = {rest, {}, body};
      note_steps();
      if (beside_) there_.agreed = rest;
      return;
    }
    const auto fits = [&](const PathPoint& point) {
      return point.u.size() == rest.u.size() && point.history.size() == rest.history.size();
    };
    if (from->body != body || !fits(from->at) || (from->agreed && !fits(*from->agreed)))
      throw InputError(
          "these steps cannot be gone on with: they are of another mesh, other nodes or other quadrature points");
    if (path_.control == Control::load && from->at.time > path_.end)
      throw SettingError(
          "time.end",
          fmt::format("these steps have come to time {:.6g}, beyond the end at {:.6g}: run without --resume",
                      from->at.time, path_.end));
    there_ = *from;
    note_steps();
  }

  /// Follows equilibria of one model from where it is.
  template <class Converged> void follow_on(const Converged& converged) {
    PathPoint from = there_.at;
    if (from.steps > 0) static_cast<State&>(from) = equations().commit(from);
    HybridSolver linear;
    follow(equations(), linear, std::move(from), path_, converged, monitor_);
  }

  /// Goes on by linear elasticity, checking every step. Why that is not enough; nothing if it comes to the end.
  std::string not_linear() {
    if (path_.control == Control::arc_length) return "steps are measured by arc length now";
    struct NotEnough {};
    auto& checks = there_.linear_checks;
    try {
      follow_on([&](const PathStep& step) {
        checks.push_back((*beside_)(step.now.state));
        if (!checks.back().enough) throw NotEnough{};
        note(step);
      });
    } catch (const NotEnough&) {
      return fmt::format("at time {:.6g} linear elasticity is not enough, {}", checks.back().time,
                         text_of(checks.back()));
    } catch (const PathError& error) {
      return fmt::format("linear elasticity ends, {}", error.what());
    } catch (const InputError& error) {  // an expression that is not finite at some time
      if (there_.history.empty() || telling_) throw;
      return fmt::format("linear elasticity ends, {}", error.what());
    }
    if (monitor_.say) {
      const auto worst = std::ranges::max_element(
          checks, {}, [](const LinearCheck& check) { return std::max(check.displacement, check.stress); });
      monitor_.say(
          fmt::format("model: linear elasticity is enough at all {} steps, most {}", checks.size(), text_of(*worst)));
    }
    return {};
  }

  /// Back to the last step at which both models agreed to rounding, or the beginning: what follows is the full model's,
  /// whatever the tolerance.
  void take_over(const std::string& why) {
    const PathPoint agreed = *std::exchange(there_.agreed, std::nullopt);
    there_.at = agreed;
    static_cast<State&>(there_.at) = beside_->as_full(agreed);
    there_.history.resize(agreed.steps);
    there_.mode.resize(0);
    beside_.reset();
    recovered_at_ = 0;
    if (monitor_.say)
      monitor_.say(fmt::format("model: {}; the full model is taken from {}", why,
                               agreed.steps == 0
                                   ? "the beginning"
                                   : fmt::format("time {:.6g}, up to which both agree to rounding", agreed.time)));
  }

  /// Whether the path ends at its last step: where it is told to, or by arc length on a plateau.
  bool is_end() {
    const auto& history = there_.history;
    if (end_ && end_->is_passed(history)) {
      if (monitor_.say)
        monitor_.say(fmt::format("the path ends at t = {:.6g}: {}, it is {:.6g}", there_.at.time,
                                 text_of(settings_.time->until.value()), end_->value(history.back())));
      return true;
    }
    if (path_.control != Control::arc_length) return false;
    const auto plateau = plateau_of(history);
    if (!plateau || (end_ && end_->is_near(history[plateau->begin], history.back()))) return false;
    const std::string way = end_ ? fmt::format("the path would not come to where {}: it is {:.6g} there",
                                               text_of(settings_.time->until.value()), end_->value(history.back()))
                                 : "say what ends the path: [time] until = { probe = ..., above = ... }";
    stop(
        fmt::format("limit load reached at t = {:.6g}: it has risen by {:.2g} % while the work doubled along the arc, "
                    "and the stiffness against it is less than {:.2g} % of that at the beginning; {}",
                    there_.at.time, 100.0 * plateau->rise, 100.0 * plateau_stiffness, way));
    return true;
  }

  /// Ends the analysis with what it has; without a step it has none.
  void stop(const std::string& why) {
    if (there_.history.empty()) throw NumericalError(why);
    result_.stopped = result_.refusal = why;
  }

  void follow_full() {
    try {
      follow_on([&](const PathStep& step) { note(step); });
    } catch (const PathError& error) {
      stop(error.what());
    } catch (const InputError& error) {  // an expression that is not finite at some time
      if (there_.history.empty() || telling_) throw;
      stop(error.what());
    }
  }

  /// Is there after a step, and tells who wants to hear.
  void note(const PathStep& step) {
    const State& state = step.now.state;
    there_.history.push_back(row_of(step));
    if (step.now.negative_pivots > 0 && there_.mode.size() == 0) note_mode(state);
    there_.at = step.after;
    static_cast<State&>(there_.at) = state;
    if (there_.agreed && there_.linear_checks.back().same && there_.agreed->steps + 1 == there_.at.steps)
      there_.agreed = there_.at;
    if (!is_told_) return;
    if (settings_.steps.fields_every > 0 && there_.at.steps % settings_.steps.fields_every == 0)
      recover();
    else
      result_.fields = {};
    telling_ = true;
    settings_.steps.done(there_, result_);
    telling_ = false;
  }

  /// How the body gives way, unless its tangent is singular: then a later step knows.
  void note_mode(const State& state) {
    try {
      there_.mode = softest_mode(equations(), state);
    } catch (const NumericalError&) {
      there_.mode.resize(0);
    }
  }

  HistoryStep<Dim> row_of(const PathStep& step) const {
    const State& state = step.now.state;
    HistoryStep<Dim> row{state.time,
                         step.now.iterations(),
                         step.now.residuals.back(),
                         0.0,
                         there_.history.empty() ? 0.0 : there_.history.back().dissipated,
                         equations().smallest_jacobian(state),
                         0.0,
                         step.now.negative_pivots,
                         equations().reactions(state),
                         {}};
    Resultants<Dim> named;  // the name may be that of another part
    for (const Reaction& reaction : settings_.reactions) named[reaction.name] = row.reactions.at(reaction.on);
    for (const auto& [name, of] : named) row.reactions[name] = of;
    const PointFields<Dim> points = equations().fields(state);
    const auto& approximation = full_.approximation();
    const Vector& weights = approximation.quadrature.weights;
    row.stored = weights.dot(points.energy);
    row.dissipated += weights.dot(points.dissipated);
    row.plastic_share = (points.dissipated.array() > 0.0).select(weights, 0.0).sum() / weights.sum();
    const Points<Dim> u =
        interpolate(approximation.shape, Points<Dim>(state.u.reshaped(Dim, approximation.nodes.cols())));
    for (const auto& place : places_) {
      const auto N = approximation.space.values(place.at);
      const auto dofs = approximation.space.cell(place.cell);
      Vec<Dim> value = Vec<Dim>::Zero();
      for (std::size_t i = 0; i < dofs.size(); ++i) value += N[i] * u.col(dofs[i]);
      row.probes.push_back(value);
    }
    return row;
  }

  /// Fields of where it is, into the result.
  void recover() {
    if (!fits_) fits_ = recovery_fits(full_.approximation());
    PointFields<Dim> points = equations().fields(at());
    result_.solution = solution_of(equations(), at(), points);
    result_.fields = recover_fields(full_.approximation(), result_.solution, *fits_);
    result_.remembered.clear();
    for (const auto& [name, values] : remembered(equations(), points.history))
      result_.remembered.emplace_back(name, recovered(full_.approximation(), values, *fits_));
    recovered_at_ = there_.at.steps;
  }

  const Settings<Dim>& settings_;
  const NonlinearEquilibrium<Dim>& full_;
  Result<Dim>& result_;
  const Monitor& monitor_;
  Locator<Dim> locator_;
  std::vector<Location<Dim>> places_;
  PathOptions path_;
  Checkpoint<Dim> there_;
  std::unique_ptr<LinearBeside<Dim>> beside_;  ///< while linear elasticity is enough
  std::optional<EndOfPath<Dim>> end_;
  std::optional<RecoveryFits<Dim>> fits_;
  int recovered_at_ = 0;  ///< step whose fields the result has
  bool is_told_ = false;  ///< whether Steps::done hears of steps
  bool telling_ = false;
};

/// Estimates the errors of the path where the finite elements do not give them, for this reason; a warning where
/// nothing does.
template <int Dim> void estimate_path_errors(const Settings<Dim>& settings, const std::string& unknown,
                                             const Result<Dim>* coarsest, Result<Dim>& result, const Monitor& monitor) {
  const bool cloud = settings.common.approximation.kind == BasisKind::mls;
  const bool possible = settings.estimated && (cloud || settings.steps.coarser);
  const std::string also = possible                       ? estimate_path(settings, coarsest, result, monitor)
                           : settings.estimated && !cloud ? "there is no coarser mesh to compare with"
                                                          : "";
  if (result.path_errors) return;
  result.warnings.push_back(
      fmt::format("displacements, forces and stresses may be off by any amount: their errors are not estimated "
                  "({}{}{}); compare {}",
                  unknown, also.empty() ? "" : ", and ", also,
                  cloud ? "clouds and meshes of two sizes, or with basis.kind = \"p2\"" : "meshes of two sizes"));
}

}  // namespace

template <int Dim> std::uint64_t fingerprint(const Approximation<Dim>& approximation) {
  return Fingerprint()
      .add(approximation.space.mesh().vertices())
      .add(approximation.nodes)
      .add(approximation.quadrature.points)
      .add(approximation.quadrature.weights)
      .value();
}

template <int Dim> bool needs_steps(const Settings<Dim>& settings, const FineMesh<Dim>& mesh) {
  return settings.time.has_value() || !materials_of(settings.common.model, mesh).linear();
}

template <int Dim> void answer_by_steps(const Settings<Dim>& settings, const Result<Dim>* coarsest, Result<Dim>& result,
                                        const Monitor& monitor) {
  if (settings.asks_for_accuracy())
    throw SettingError(
        "accuracy",
        "an accuracy can be asked for where materials are linear (analysis.model = \"linear\" takes them so) and "
        "nothing changes with time");
  if (!settings.cases.empty())
    throw SettingError(
        "case",
        "load cases share one matrix: materials have to be linear (analysis.model = \"linear\" takes them so), and "
        "nothing may change with time");
  approximate_once(settings, result, monitor);
  const NonlinearEquilibrium<Dim> full(result.approximation, result.model, program_of(settings));
  Walk<Dim> walk(settings, full, result, monitor);
  walk.go();
  walk.finish();
  const NonlinearEquilibrium<Dim>& equations = walk.equations();
  result.balance = {equations.reactions(walk.at()), equations.applied(walk.at())};
  Program<Dim> program = program_of(settings);
  if (&equations != &full)  // linear ones took over
    program.loads = [loads = std::move(program.loads)](double time) { return at_rest(loads(time)); };
  if (const std::string unknown = estimate_steps(settings, std::move(program), walk.at(), result, monitor);
      !unknown.empty())
    estimate_path_errors(settings, unknown, coarsest, result, monitor);
  if (settings.estimated) check_turning_loads(settings, result);
  warn_of_path(settings, equations, walk.at(), result);
}

template std::uint64_t fingerprint<2>(const Approximation<2>&);
template std::uint64_t fingerprint<3>(const Approximation<3>&);
template bool needs_steps<2>(const Settings<2>&, const FineMesh<2>&);
template bool needs_steps<3>(const Settings<3>&, const FineMesh<3>&);
template void answer_by_steps<2>(const Settings<2>&, const Result<2>*, Result<2>&, const Monitor&);
template void answer_by_steps<3>(const Settings<3>&, const Result<3>*, Result<3>&, const Monitor&);

}  // namespace efree::internal
