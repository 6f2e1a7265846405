// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/newton.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree {

Vector TangentSolver::change(const State& at, const Vector& r) {
  const bool first = K_.size() == 0;
  equations_.tangent(at, K_);
  if (!K_.coeffs().allFinite()) throw NumericalError("the tangent is not finite");
  if (first) linear_.analyse(K_, equations_.node_of_unknowns());
  linear_.factorize(K_);
  const Vector change = linear_.solve(-r);
  if (!change.allFinite()) throw NumericalError("the change of the solution is not finite");
  return change;
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
  Vector change = tangent.change(from, equations.first_residual(from, start));
  Converged result;
  std::string why;
  std::optional<Trial> trial;
  for (int cuts = 0; !trial && cuts <= options.max_cuts; ++cuts)
    trial = tried(equations, start, cuts == 0 ? change : Vector(change *= 0.5), 1.0, why);
  if (!trial) throw NumericalError(why);
  result.state = std::move(trial->state);
  Vector r = std::move(trial->residual);
  for (;;) {
    const double scale = equations.force_scale(result.state), out = r.lpNorm<Eigen::Infinity>();
    result.residuals.push_back(out == 0.0 ? 0.0 : out / scale);
    if (out <= options.tolerance * scale) break;
    if (result.iterations() == options.max_iterations)
      throw NumericalError(fmt::format(
          "Newton's method does not converge: after {} iterations forces of {:.2g} are out of balance where "
          "{:.2g} act",
          result.iterations(), out, scale));
    change = tangent.change(result.state, r);
    Trial next = line_search(equations, result.state, r, change, options.max_cuts);
    result.state = std::move(next.state);
    r = std::move(next.residual);
  }
  result.negative_pivots = tangent.negative_pivots();
  return result;
}

State follow(const Equations& equations, LinearSolver& linear, State from, const PathOptions& options,
             const std::function<void(const PathStep&)>& converged, const Monitor& monitor) {
  constexpr int easy = 5, hard = 10;
  constexpr double rounding = 1e-9;  // of a step: what is left by less is not a step of its own
  require(options.step > 0.0 && options.end > from.time, "a path needs a step > 0 and an end that is to come");
  const double least = options.min_step > 0.0 ? options.min_step : 1e-3 * options.step;
  const double most = options.max_step > 0.0 ? options.max_step : std::max(options.step, 0.1 * options.end);
  const double begin = from.time;
  Stage stage("path", monitor);
  TangentSolver tangent(equations, linear);
  double step = options.step;
  for (int number = 1; from.time < options.end;) {
    stage.tick((from.time - begin) / (options.end - begin));
    const bool last = from.time + (1.0 + rounding) * step >= options.end;
    const double time = last ? options.end : from.time + step;
    std::optional<Converged> now;
    std::string why;
    try {
      now = newton(equations, tangent, from, time, options.newton);
    } catch (const NumericalError& error) {
      why = error.what();
    }
    if (!now) {
      if (0.5 * step < least)
        throw PathError(fmt::format("at time {:.6g} steps of {:.3g} do not converge: {}", from.time, step, why),
                        from.time, number - 1);
      step *= 0.5;
      continue;
    }
    if (now->iterations() <= easy) step = std::min(most, 1.5 * step);
    if (now->iterations() >= hard) step = std::max(least, 0.5 * step);
    PathStep done{std::move(from), std::move(*now), {}, number++, step};
    done.after = equations.commit(done.now.state);
    if (converged) converged(done);
    from = std::move(done.after);
  }
  return from;
}

}  // namespace efree
