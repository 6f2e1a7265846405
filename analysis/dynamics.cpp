// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/dynamics.hpp"

#include "efree/analysis/utilisation.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/clock.hpp"
#include "efree/core/memory.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

namespace efree {

template <int Dim> std::vector<std::pair<std::string, Vector>> point_scalars(const Dynamics<Dim>& dynamics) {
  const Index n = dynamics.num_points();
  const Tensors F = dynamics.deformation(), sigma = dynamics.cauchy_stress();
  const Points<Dim> v = dynamics.point_velocities();
  Vector mises(n), pressure(n), J(n), speed(n);
  for (Index p = 0; p < n; ++p) {
    const Voigt<3> stress = stress_of<3>(sigma.col(p));
    mises[p] = von_mises<3>(stress);
    pressure[p] = -stress.template head<3>().mean();
    J[p] = Eigen::Map<const Mat<3>>(F.col(p).data()).determinant();
    speed[p] = v.col(p).norm();
  }
  std::vector<std::pair<std::string, Vector>> result{
      {"von_mises", mises}, {"pressure", pressure}, {"J", J}, {"speed", speed}, {"damage", dynamics.damage()}};
  std::map<std::string, Vector> of_histories;
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    const Matrix history = dynamics.history(b);
    for (const HistoryPart& part : dynamics.material(b).history_parts())
      if (part.size == 1)
        of_histories.try_emplace(part.name, Vector::Zero(n))
            .first->second.segment(dynamics.first_point(b), history.cols()) = history.row(part.offset);
  }
  for (auto& [name, values] : of_histories) result.emplace_back(name, std::move(values));
  const std::vector<BodyState<Dim>>& bodies = dynamics.world().bodies;
  if (std::ranges::any_of(bodies, [](const auto& body) { return body.strength.is_given(); })) {
    Vector utilised(n);
    for (Index b = 0; b < dynamics.num_bodies(); ++b)
      for (Index p = dynamics.first_point(b); p < dynamics.first_point(b + 1); ++p)
        utilised[p] = utilisation<3>(bodies[b].strength, stress_of<3>(sigma.col(p)));
    result.emplace_back("utilisation", std::move(utilised));
  }
  return result;
}

namespace {

/// NaN where the scheme has no such node any more. Of a material point: displacement of the probe's position, which
/// moves with the point.
template <int Dim> std::vector<double> measure_node(const DynamicsProbe<Dim>& probe, const ProbeNode<Dim>& node,
                                                    const DynamicsModel<Dim>& model) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  const Index a = model.first_probed(node.body) + node.number;
  if (a >= model.first_probed(node.body + 1))
    return std::vector<double>(2 * Dim, std::numeric_limits<double>::quiet_NaN());
  Vec<Dim> u = -node.start, v;
  if (model.probes_points) {
    const auto [chunk, p] = dynamics.world().locate(a);
    const Mat<Dim> F = chunk.matter.now.gradient(p).template topLeftCorner<Dim, Dim>();
    Vec<Dim> from_point = probe.at - node.start;
    // At most to a corner of the point: F is not known beyond.
    const double reach = 0.5 * std::sqrt(static_cast<double>(Dim)) * model.point_sizes[a];
    if (from_point.norm() > reach) from_point *= reach / from_point.norm();
    u += chunk.matter.x.col(p) + (F - Mat<Dim>::Identity()) * from_point;
    v = dynamics.point_velocities().col(a);
  } else {
    u += dynamics.nodes().col(a);
    v = dynamics.velocities().col(a);
  }
  std::vector<double> both(u.begin(), u.end());
  both.insert(both.end(), v.begin(), v.end());
  return both;
}

/// Smallest and largest value of a coordinate at the corners of a material point: of a square (cube) that is deformed
/// as the point is. Bodies end there.
template <int Dim> std::pair<double, double> extremes_at_corners(const DynamicsModel<Dim>& model,
                                                                 const ScalarField<Dim>& coordinate, Index point) {
  const auto [chunk, p] = model.dynamics.world().locate(point);
  const Mat<Dim> F = chunk.matter.now.gradient(p).template topLeftCorner<Dim, Dim>();
  double smallest = std::numeric_limits<double>::infinity(), largest = -smallest;
  for (int corner = 0; corner < 1 << Dim; ++corner) {
    Vec<Dim> half = Vec<Dim>::Constant(0.5 * model.point_sizes[point]);
    for (int i = 0; i < Dim; ++i)
      if ((corner >> i & 1) != 0) half[i] = -half[i];
    const double value = coordinate(chunk.matter.x.col(p) + F * half);
    smallest = std::min(smallest, value);
    largest = std::max(largest, value);
  }
  return {smallest, largest};
}

/// Likewise at the ends of a particle along the axes: a ball of this radius around its node.
template <int Dim>
std::pair<double, double> extremes_of_ball(const ScalarField<Dim>& coordinate, const Vec<Dim>& centre, double radius) {
  double smallest = coordinate(centre), largest = smallest;
  for (int i = 0; i < Dim && radius > 0.0; ++i)
    for (const double side : {-radius, radius}) {
      const double value = coordinate(centre + side * Vec<Dim>::Unit(i));
      smallest = std::min(smallest, value);
      largest = std::max(largest, value);
    }
  return {smallest, largest};
}

/// The number that this share of all, more than 0, does not exceed.
double quantile(std::vector<double>& values, double share) {
  const auto count = static_cast<double>(values.size());
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(std::ceil(share * count)) - 1;
  std::ranges::nth_element(values, place);
  return *place;
}

/// Of nodes or material points, as the probe has it.
template <int Dim> double measure_extreme(const DynamicsProbe<Dim>& probe, const DynamicsModel<Dim>& model,
                                          const std::vector<std::pair<std::string, Vector>>& scalars) {
  using Kind = typename DynamicsProbe<Dim>::Kind;
  const Dynamics<Dim>& dynamics = model.dynamics;
  const bool nodal = probe.field.empty() && !model.probes_points;
  const Points<Dim> points = nodal ? dynamics.nodes() : dynamics.points();
  const auto field = std::ranges::find(scalars, probe.field, [](const auto& entry) { return entry.first; });
  const Vector& radius = dynamics.world().nodes.radius;
  const auto extremes_of = [&](Index k) {
    if (!probe.field.empty()) return std::pair(field->second[k], field->second[k]);
    if (!nodal) return extremes_at_corners(model, probe.coordinate, k);
    return extremes_of_ball<Dim>(probe.coordinate, points.col(k), radius.size() == 0 ? 0.0 : radius[k]);
  };
  std::vector<double> highs, lows;  // of the latter minus these
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    if (!probe.region.empty() && probe.region != model.names[b]) continue;
    const Index begin = nodal ? dynamics.first_node(b) : dynamics.first_point(b);
    const Index end = nodal ? dynamics.first_node(b + 1) : dynamics.first_point(b + 1);
    for (Index k = begin; k < end; ++k) {
      if (!probe.box.isEmpty() && !probe.box.contains(Vec<Dim>(points.col(k)))) continue;
      const auto [low, high] = extremes_of(k);
      highs.push_back(high);
      lows.push_back(-low);
    }
  }
  if (highs.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double largest = quantile(highs, probe.share), smallest = -quantile(lows, probe.share);
  return probe.kind == Kind::largest ? largest : probe.kind == Kind::smallest ? smallest : largest - smallest;
}

/// NaN at the start.
template <int Dim> double measure_mean_force(const DynamicsProbe<Dim>& probe, const Dynamics<Dim>& dynamics) {
  if (dynamics.time() == 0.0) return std::numeric_limits<double>::quiet_NaN();
  return dynamics.rigid_bodies()[probe.rigid_body].impulse[probe.component] / dynamics.time();
}

}  // namespace

template <int Dim>
std::vector<std::pair<std::string, std::vector<double>>> measure_probes(const DynamicsSettings<Dim>& settings,
                                                                        const DynamicsModel<Dim>& model) {
  const bool needs_fields =
      std::ranges::any_of(settings.probes, [](const auto& probe) { return !probe.field.empty(); });
  const auto scalars = needs_fields ? point_scalars(model.dynamics) : std::vector<std::pair<std::string, Vector>>{};
  std::vector<std::pair<std::string, std::vector<double>>> result;
  for (std::size_t k = 0; k < settings.probes.size(); ++k) {
    const DynamicsProbe<Dim>& probe = settings.probes[k];
    const auto& node = model.probe_nodes[k];
    if (node)
      result.emplace_back(probe.name, measure_node(probe, *node, model));
    else if (probe.kind == DynamicsProbe<Dim>::Kind::mean_force)
      result.emplace_back(probe.name, std::vector{measure_mean_force(probe, model.dynamics)});
    else
      result.emplace_back(probe.name, std::vector{measure_extreme(probe, model, scalars)});
  }
  return result;
}

std::string rigid_partner_name(const ContactPartner& partner) {
  return fmt::format("{}.{}", partner.kind == ContactPartner::Kind::wall ? "wall" : "rigid_body", partner.number);
}

namespace {

void call(const std::function<void()>& function) {
  if (function) function();
}

/// The stable step at the start, in which nodes move by half a spacing at most.
template <int Dim> double first_step(const Dynamics<Dim>& dynamics) {
  return std::min(dynamics.stable_step(), step_of_half_spacing(dynamics.world(), {}, dynamics.nodes_persist()));
}

/// Says how long a run will be, as if steps went on as long as the last ones: after a fiftieth of it, and again
/// whenever steps have become so short, or slow, that it is half as long again.
class Forecast {
 public:
  Forecast(double from, double end) : from_(from), end_(end) {}
  /// After every step: `steps` have led to `time` in so many seconds.
  void update(double time, double step, Index steps, double seconds, const Monitor& monitor) {
    constexpr double share = 0.02, least = 10.0, again = 1.5, remembered = 50.0;
    step_ += (step - step_) / std::min(static_cast<double>(steps), remembered);
    if (time < from_ + share * (end_ - from_)) return;
    const double of_all = 1.0 + (end_ - time) / (step_ * static_cast<double>(steps)), all = seconds * of_all;
    if (all < std::max(least, again * said_)) return;
    said_ = all;
    monitor.say(fmt::format("forecast at time {:.3g}: {:.2g} steps in all, {:.2g} s, {:.2g} MB", time,
                            static_cast<double>(steps) * of_all, all, peak_memory_mb()));
  }

 private:
  double from_, end_, step_ = 0.0, said_ = 0.0;  // a mean step, and what was said last
};

/// Steps between looks at whether bodies are at rest.
constexpr Index between_checks = 16;

/// Ends a run whose steps become too short.
template <int Dim> class StepGuard {
 public:
  StepGuard(const Dynamics<Dim>& dynamics, const DynamicsSettings<Dim>& settings)
      : dynamics_(dynamics),
        min_step_(settings.min_step > 0.0 ? settings.min_step
                                          : 1e-4 * std::min({first_step(dynamics), settings.max_step, settings.end})) {}

  /// Before a step: why there cannot be one, or nothing. left: until the end of the run.
  std::string check_stable_step(double stable, double left) const {
    if (stable >= min_step_ || left <= stable) return {};
    return fmt::format(
        "at time {:.6g} the stable step is {:.3g}, less than min_step = {:.3g}: a part of a body is crushed, or has "
        "become very stiff. Try a coarser mesh there, or a smaller min_step",
        dynamics_.time(), stable, min_step_);
  }
  /// After a step that was at most `limit`: likewise. Steps are shorter than stable ones where nodes, or rigid bodies,
  /// are fast for the spacing; single ones may be.
  std::string check_step(double step, double limit) {
    constexpr Index short_steps_in_a_row = 100;
    short_steps_ = step < std::min(min_step_, limit) ? short_steps_ + 1 : 0;
    if (short_steps_ < short_steps_in_a_row) return {};
    return fmt::format(
        "at time {:.6g} steps are {:.3g} long, less than min_step = {:.3g}: nodes nearly coincide (a sliver of the "
        "mesh), or nodes or rigid bodies are very fast for the spacing. Try a better mesh, or a smaller min_step",
        dynamics_.time(), step, min_step_);
  }

 private:
  const Dynamics<Dim>& dynamics_;
  double min_step_;
  Index short_steps_ = 0;
};

/// Why the result is rejected at the end; empty: it is not.
template <int Dim> std::string check_energy(const Dynamics<Dim>& dynamics, const DynamicsSettings<Dim>& settings) {
  const double error = dynamics.energy().largest_error();
  const double limit = std::min(rejected_imbalance, settings.options.imbalance);
  if (std::abs(error) <= limit) return {};
  return fmt::format(
      "the energy is off by {:.2g} %, more than {:.2g} %: try smaller steps (dynamics.courant) or a finer mesh",
      100.0 * error, 100.0 * limit);
}

}  // namespace

template <int Dim> DynamicsOutcome run_dynamics(DynamicsModel<Dim>& model, const DynamicsSettings<Dim>& settings,
                                                const DynamicsObserver& observer, const Monitor& monitor) {
  const internal::Stopwatch seconds;
  Dynamics<Dim>& dynamics = model.dynamics;
  DynamicsOutcome outcome;
  const Stage stage("dynamics", monitor);
  const double from = dynamics.time();
  if (dynamics.steps() == 0) {
    call(observer.history_line);
    call(observer.frame);
  }
  // Whether the last step has passed one of so many times up to the end.
  const auto passes = [&](double before, Index times) {
    const double interval = settings.end / static_cast<double>(times);
    return times > 0 && std::floor(before / interval) < std::floor(dynamics.time() / interval);
  };
  const auto is_over = [&] { return settings.end - dynamics.time() <= 1e-12 * settings.end; };
  const auto report_progress = [&](double now) {
    stage.tick(dynamics.time() / settings.end);
    if (monitor.detail)
      monitor.detail(fmt::format("time {:.4g} of {:.4g}, step {} of {:.3g}, energy off by {:.2g} %, {:.0f} s to go",
                                 dynamics.time(), settings.end, dynamics.steps(), dynamics.stable_step(),
                                 100.0 * dynamics.energy().error(),
                                 now * (settings.end - dynamics.time()) / (dynamics.time() - from)));
  };
  StepGuard<Dim> guard(dynamics, settings);
  Forecast forecast(from, settings.end);
  const Index steps_before = dynamics.steps();
  double next_checkpoint = settings.checkpoint_interval, next_progress = 0.0;
  while (!is_over() && !outcome.at_rest) {
    if (monitor.cancelled && monitor.cancelled()) {
      if (dynamics.steps() > 0) call(observer.checkpoint);
      throw Cancelled("dynamics");
    }
    const double before = dynamics.time(), left = settings.end - before;
    outcome.stop_reason = guard.check_stable_step(dynamics.stable_step(), left);
    if (!outcome.stop_reason.empty()) break;
    const double limit = std::min(settings.max_step, dynamics.step_towards(left));
    outcome.stop_reason = guard.check_step(dynamics.step(limit), limit);
    if (!outcome.stop_reason.empty()) break;
    const bool again = outcome.residual && !std::isfinite(*outcome.residual);  // nodes had just stopped
    if (settings.residual > 0.0 && before >= settings.options.rest_from &&
        (again || dynamics.steps() % between_checks == 0)) {
      outcome.residual = dynamics.residual();
      outcome.at_rest = *outcome.residual <= settings.residual;
    }
    const bool last = is_over() || outcome.at_rest;
    if (last || passes(before, settings.history_lines)) call(observer.history_line);
    if (last || passes(before, settings.frames)) call(observer.frame);
    const double now = seconds();
    if (!last && monitor.say)
      forecast.update(dynamics.time(), dynamics.time() - before, dynamics.steps() - steps_before, now, monitor);
    if (now >= next_progress || last) {
      next_progress = now + 0.1;
      report_progress(now);
    }
    if (last) {
      outcome.stop_reason = check_energy(dynamics, settings);
    } else if (now >= settings.time_limit) {
      call(observer.checkpoint);
      outcome.can_resume = static_cast<bool>(observer.checkpoint);
      outcome.stop_reason =
          fmt::format("the time limit of {:.6g} s ended the run at time {:.6g} of {:.6g}{}", settings.time_limit,
                      dynamics.time(), settings.end, outcome.can_resume ? "; --resume continues it" : "");
      break;
    } else if (now >= next_checkpoint) {
      call(observer.checkpoint);
      next_checkpoint = seconds() + settings.checkpoint_interval;
    }
  }
  outcome.seconds = seconds();
  return outcome;
}

template std::vector<std::pair<std::string, Vector>> point_scalars(const Dynamics<2>&);
template std::vector<std::pair<std::string, Vector>> point_scalars(const Dynamics<3>&);
template std::vector<std::pair<std::string, std::vector<double>>> measure_probes(const DynamicsSettings<2>&,
                                                                                 const DynamicsModel<2>&);
template std::vector<std::pair<std::string, std::vector<double>>> measure_probes(const DynamicsSettings<3>&,
                                                                                 const DynamicsModel<3>&);
template DynamicsOutcome run_dynamics(DynamicsModel<2>&, const DynamicsSettings<2>&, const DynamicsObserver&,
                                      const Monitor&);
template DynamicsOutcome run_dynamics(DynamicsModel<3>&, const DynamicsSettings<3>&, const DynamicsObserver&,
                                      const Monitor&);

}  // namespace efree
