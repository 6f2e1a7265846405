// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/newton.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

namespace efree {

Matrix TangentSolver::change(const State& at, const Matrix& r, bool kept) {
  const bool first = K_.size() == 0;
  if (!factored_ || !(kept || equations_.linear())) {
    equations_.tangent(at, K_);
    if (!K_.coeffs().allFinite()) throw NumericalError("the tangent is not finite");
    if (first) linear_.analyse(K_, equations_.node_of_unknowns());
    linear_.factorize(K_);
    factored_ = true;
  }
  Matrix change = linear_.solve(-r);
  for (Index k = 0; k < r.cols(); ++k) iterate(at, r.col(k), change.col(k));
  if (!change.allFinite()) throw NumericalError("the change of the solution is not finite");
  return change;
}

/// From a change by the factor alone to that by all of the derivative. What the last directions leave is left to
/// Newton's method (an inexact one; Dembo, Eisenstat & Steihaug 1982), unless it is too much for it to come nearer.
void TangentSolver::iterate(const State& at, const Vector& r, Eigen::Ref<Vector> change) const {
  constexpr double enough = 1e-8, bearable = 0.1;
  constexpr int most = 30;
  std::vector<Vector> directions, forces;
  Vector left = -r, direction = change, lacking = equations_.not_in_tangent(at, direction);
  if (lacking.size() == 0) return;
  change.setZero();
  for (int k = 0; k < most; ++k) {
    Vector force = K_.selfadjointView<Eigen::Lower>() * direction + lacking;
    for (std::size_t i = 0; i < forces.size(); ++i) {
      const double share = forces[i].dot(force);
      force -= share * forces[i];
      direction -= share * directions[i];
    }
    const double size = force.norm();
    if (!(size > 0.0)) break;
    directions.push_back(direction / size);
    forces.push_back(force / size);
    const double share = forces.back().dot(left);
    change += share * directions.back();
    left -= share * forces.back();
    if (left.norm() <= enough * r.norm()) return;
    direction = linear_.solve(left);
    lacking = equations_.not_in_tangent(at, direction);
  }
  if (!(left.norm() <= bearable * r.norm()))
    throw NumericalError(fmt::format(
        "the tangent is too far from symmetric: iterations with the factor of its symmetric part leave {:.2g} "
        "of the forces out of balance",
        left.norm() / r.norm()));
}

OutOfBalance::OutOfBalance(const Vector& r, const Vector& scales) {
  for (Index i = 0; i < r.size(); ++i) {
    const double here = r[i] == 0.0 ? 0.0 : std::abs(r[i]) / scales[i];
    if (std::isnan(share) || here <= share) continue;
    share = here;
    force = std::abs(r[i]);
    scale = scales[i];
  }
}

namespace {

/// A state that was tried, and the forces that it leaves out of balance.
struct Trial {
  State state;
  Vector residual;
  double work;  ///< of the residual on the change
};

/// The state changed by `share` of a change; nothing where the materials have no answer.
std::optional<Trial> tried(const Equations& equations, const State& from, const Vector& change, double share,
                           std::string& why) {
  try {
    Trial trial{equations.moved(from, share * change), {}, 0.0};
    trial.residual = equations.residual(trial.state);
    trial.work = trial.residual.dot(change);
    if (trial.residual.allFinite()) return trial;
    why = "forces are not finite";
  } catch (const NumericalError& error) {
    why = error.what();
  }
  return std::nullopt;
}

/// As much of a change as leads towards balance: all of it, if that leaves less work (or force) undone than there was.
Trial line_search(const Equations& equations, const State& from, const Vector& r, const Vector& change, int max_cuts) {
  constexpr double enough = 0.8;
  std::string why;
  double share = 1.0;
  std::optional<Trial> best = tried(equations, from, change, share, why);
  int cuts = 0;
  for (; !best && cuts < max_cuts; ++cuts) best = tried(equations, from, change, share *= 0.5, why);
  if (!best) throw NumericalError(why);
  const double work = r.dot(change), force = r.norm();
  const auto leads_away = [&](const Trial& trial) {
    return std::abs(trial.work) > enough * std::abs(work) && trial.residual.norm() > force;
  };
  for (; leads_away(*best) && cuts < max_cuts; ++cuts) {
    // Where the work of the residual would vanish, if it were linear in the share.
    const double slope = best->work - work;
    const double next = slope != 0.0 ? -work / slope * share : 0.5 * share;
    share = next > 0.1 * share && next < 0.5 * share ? next : 0.5 * share;
    auto trial = tried(equations, from, change, share, why);
    if (trial && trial->residual.norm() < best->residual.norm()) best = std::move(trial);
  }
  return std::move(*best);
}

}  // namespace

Converged newton(const Equations& equations, TangentSolver& tangent, const State& from, double factor,
                 const NewtonOptions& options) {
  const State start = equations.under(factor, from);
  // Nothing is tried at the start itself, where what is prescribed jumps.
  State here = from;
  here.dt = start.dt;  // the flow of materials that depend on its rate takes time
  Vector change = tangent.change(here, equations.first_residual(from, start));
  Converged result;
  std::string why;
  std::optional<Trial> trial;
  for (int cuts = 0; !trial && cuts <= options.max_cuts; ++cuts)
    trial = tried(equations, start, cuts == 0 ? change : Vector(change *= 0.5), 1.0, why);
  if (!trial) throw NumericalError(why);
  result.state = std::move(trial->state);
  Vector r = std::move(trial->residual);
  for (;;) {
    const OutOfBalance out(r, equations.force_scale(result.state));
    result.residuals.push_back(out.share);
    if (out.share <= options.tolerance) break;
    if (result.iterations() == options.max_iterations)
      throw NumericalError(
          fmt::format("Newton's method does not converge: after {} iterations forces of {:.2g} are "
                      "out of balance where {:.2g} act",
                      result.iterations(), out.force, out.scale));
    const auto n = result.residuals.size();
    const bool kept = n > 1 && result.residuals[n - 1] <= options.keep * result.residuals[n - 2];
    change = tangent.change(result.state, r, kept);
    Trial next = line_search(equations, result.state, r, change, options.max_cuts);
    result.state = std::move(next.state);
    r = std::move(next.residual);
  }
  result.negative_pivots = tangent.negative_pivots();
  return result;
}

namespace {

/// One way to take a step of a size from a point of a path; notes in `after` what its next step needs.
class Stepper {
 public:
  Stepper(const Equations& equations, LinearSolver& linear, const PathOptions& options)
      : equations_(equations), tangent_(equations, linear), options_(options) {}
  virtual ~Stepper() = default;
  virtual Converged step(const PathPoint& from, double size, PathPoint& after) = 0;
  /// Why a path ends where steps of a size do not converge: at a limit load, if so.
  std::string end_of_path(const PathPoint& from, double size, const std::string& why) {
    constexpr double next_to_nothing = 0.1;
    const auto stiffness = current_stiffness(from, size);
    if (from.steps == 0 || !stiffness || *stiffness >= next_to_nothing)
      return fmt::format("at time {:.6g} steps of {:.3g} do not converge: {}", from.time, size, why);
    const bool by_loads = equations_.loads_change(from.time, from.time + size);
    std::vector<std::string> ways;
    if (by_loads) ways.emplace_back("prescribe displacements");
    const bool is_zero = std::abs(*stiffness) <= 1e-6;  // all flows: along an arc there is nothing more to find
    if (options_.control == Control::load && !is_zero)
      ways.emplace_back("use arc length ([time] control = \"arc_length\")");
    const std::string share = is_zero            ? "zero"
                              : *stiffness < 0.0 ? "negative"
                                                 : fmt::format("{:.2g} % of that at rest", 100.0 * *stiffness);
    return fmt::format(
        "{} reached at t = {:.6g}: steps of {:.3g} beyond it do not converge: {}; the stiffness against {} there is "
        "{}{}",
        by_loads ? "limit load" : "limit point", from.time, size, why, by_loads ? "the load" : "what is prescribed",
        share, ways.empty() ? "" : fmt::format("; {} to go on", fmt::join(ways, " or ")));
  }

 protected:
  const Equations& equations_;
  TangentSolver tangent_;
  const PathOptions& options_;

 private:
  /// Stiffness against what changes with time, where the tangent leads to in a step beyond a point, over that at rest:
  /// the current stiffness parameter (Bergan, Horrigmoe, Krakeland & Soreide 1978), 0 where loads have a maximum.
  /// Nothing where it cannot be told.
  std::optional<double> current_stiffness(const PathPoint& from, double size) {
    try {
      const State later = equations_.under(from.time + size, from);
      const Vector force = (equations_.first_residual(from, later) - equations_.residual(from)) / size;
      const State beyond = equations_.moved(later, size * Vector(tangent_.change(from, force).col(0)));
      const double at_rest = force.dot(tangent_.change(equations_.rest(), force).col(0));
      SymmetricMatrix K;
      equations_.tangent(beyond, K);  // throws what materials throw
      double now = 0.0;
      try {
        now = force.dot(tangent_.change(beyond, force).col(0));
      } catch (const NumericalError&) {  // singular
        return 0.0;
      }
      if (at_rest == 0.0 || now == 0.0) return std::nullopt;
      return at_rest / now;
    } catch (const NumericalError&) {
      return std::nullopt;
    }
  }
};

class TimeStepper final : public Stepper {
 public:
  using Stepper::Stepper;
  Converged step(const PathPoint& from, double size, PathPoint& /*after*/) override {
    constexpr double rounding = 1e-9;  // of a step: what is left by less is not a step of its own
    double to = options_.end;
    for (const double stop : options_.stops)
      if (stop > from.time + rounding * size) to = std::min(to, stop);
    if (from.time + (1.0 + rounding) * size < to) to = from.time + size;
    return newton(equations_, tangent_, from, to, options_.newton);
  }
};

/// Cylindrical arc length (Crisfield 1981): the change of all unknowns since the last step has a given norm. The path
/// goes on in the direction that it has come from (Feng, Peric & Owen 1996).
class ArcStepper final : public Stepper {
 public:
  using Stepper::Stepper;
  Converged step(const PathPoint& from, double size, PathPoint& after) override {
    // From a committed state plastic materials answer as elastic ones, and the path would turn back along the way that
    // unloads; that in balance before the commit goes on flowing.
    State at = from;
    if (from.steps > 0) {
      at.history = from.remembered;
      at.dt = from.lasted;
    }
    const Vector rate = tangent_.change(at, force_by_time(at));
    const double per_time = from.per_time > 0.0 ? from.per_time : rate.norm();
    if (!(per_time > 0.0)) throw NumericalError("nothing changes with time: there is no arc to follow");
    const double length = size * per_time;
    const double sense = from.came_by.size() > 0 && from.came_by.dot(rate) < 0.0 ? -1.0 : 1.0;
    double time = sense * length / rate.norm();
    Vector all = time * rate;
    Converged result{.state = equations_.moved(equations_.under(from.time + time, from), all), .residuals = {}};
    for (;;) {
      const Vector r = equations_.residual(result.state);
      const OutOfBalance out(r, equations_.force_scale(result.state));
      result.residuals.push_back(out.share);
      if (out.share <= options_.newton.tolerance) break;
      if (result.iterations() == options_.newton.max_iterations || !r.allFinite())
        throw NumericalError(
            fmt::format("Newton's method does not converge along the arc: after {} iterations forces of {:.2g} are out "
                        "of balance where {:.2g} act",
                        result.iterations(), out.force, out.scale));
      Matrix forces(r.size(), 2);
      forces << r, force_by_time(result.state);
      const Matrix changes = tangent_.change(result.state, forces);
      const Vector back = changes.col(0), along = changes.col(1);
      const Vector start = all + back;
      time = root(along, start, all, length);
      const Vector change = back + time * along;
      all += change;
      result.state = equations_.moved(equations_.under(result.state.time + time, result.state), change);
    }
    result.negative_pivots = tangent_.negative_pivots();
    if (result.state.time > options_.end)  // the end itself, by a step in time
      result = newton(equations_, tangent_, from, options_.end, options_.newton);
    after.per_time = per_time;
    after.came_by = std::move(all);
    after.remembered = from.history;
    after.lasted = result.state.dt;
    return result;
  }

 private:
  /// Change of the forces out of balance per time, taken for constant over a millionth of a step.
  Vector force_by_time(const State& at) const {
    const double little = 1e-6 * options_.first_step();
    const State later = equations_.under(at.time + little, at);
    return (equations_.first_residual(at, later) - equations_.residual(at)) / little;
  }
  /// The x with |start + x along| = length for which that points as `all` does.
  static double root(const Vector& along, const Vector& start, const Vector& all, double length) {
    const double a = along.squaredNorm(), b = along.dot(start), c = start.squaredNorm() - length * length;
    const double discriminant = b * b - a * c;
    if (discriminant < 0.0) throw NumericalError("the arc does not meet the path");
    const double first = (-b - std::sqrt(discriminant)) / a, second = (-b + std::sqrt(discriminant)) / a;
    const double to_first = all.dot(start + first * along), to_second = all.dot(start + second * along);
    return to_first > to_second ? first : second;
  }
};

}  // namespace

PathPoint follow(const Equations& equations, LinearSolver& linear, PathPoint from, const PathOptions& options,
                 const std::function<void(const PathStep&)>& converged, const Monitor& monitor) {
  constexpr int easy = 5, hard = 10;
  constexpr double near_least = 20.0;
  require(options.step >= 0.0 && options.scale > 0.0, "a path needs steps > 0");
  require(from.steps > 0 || options.end > from.time, "a path needs an end that is to come");
  const double least = options.least_step(), most = options.largest_step();
  if (from.steps == 0) from.began = from.time;
  const double begin = from.began;
  Stage stage("path", monitor);
  std::unique_ptr<Stepper> stepper;
  if (options.control == Control::load)
    stepper = std::make_unique<TimeStepper>(equations, linear, options);
  else
    stepper = std::make_unique<ArcStepper>(equations, linear, options);
  double size = from.next > 0.0 ? from.next : options.first_step();
  while (from.time < options.end) {
    stage.tick(std::max(0.0, (from.time - begin) / (options.end - begin)));
    if (from.steps >= options.max_steps)
      throw PathError(fmt::format("at time {:.6g} the path is not at its end after {} steps", from.time, from.steps),
                      from.time, from.steps);
    std::optional<Converged> now;
    PathPoint after;
    std::string why;
    try {
      now = stepper->step(from, size, after);
      equations.check(now->state);
    } catch (const NumericalError& error) {
      now.reset();
      why = error.what();
    }
    if (!now) {
      if (0.5 * size < least) throw PathError(stepper->end_of_path(from, size, why), from.time, from.steps);
      if (monitor.detail)
        monitor.detail(fmt::format("t = {:.6g}: a step of {:.3g} does not converge and is halved", from.time, size));
      size *= 0.5;
      continue;
    }
    if (now->state.time < begin)
      throw PathError(
          fmt::format("at time {:.6g} the path has come back to before its beginning: it unloads", now->state.time),
          from.time, from.steps);
    // Near the least size, steps that are not easy either grow: a path would never end at that size.
    const int growing = size < near_least * least ? hard - 1 : easy;
    if (now->iterations() <= growing) size = std::min(most, 1.5 * size);
    if (now->iterations() >= hard) size = std::max(least, 0.5 * size);
    after.steps = from.steps + 1;
    after.began = begin;
    after.next = size;
    static_cast<State&>(after) = equations.commit(now->state);
    PathStep done{std::move(from), std::move(*now), std::move(after)};
    if (monitor.detail)
      monitor.detail(fmt::format("t = {:.6g}: step {}, {} iterations{}", done.after.time, done.after.steps,
                                 done.now.iterations(), done.now.negative_pivots > 0 ? ", not stable" : ""));
    if (converged) converged(done);
    const bool is_end = options.until && options.until(done);
    from = std::move(done.after);
    if (is_end) break;
  }
  return from;
}

}  // namespace efree
