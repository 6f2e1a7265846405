// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads that change within steps in ways that steps do not see.
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>

namespace efree::internal {
namespace {

/// Times within a step, and vertices of the mesh, at which loads are looked at.
constexpr int times_in_step = 16;
constexpr double golden = 0.6180339887498949;
constexpr Index vertices_looked_at = 5, vertices_of_distances = 50;
/// Distance of a load from the straight line between two steps, over its largest value, from which it is warned of.
constexpr double bearable_distance = 0.05;

/// What acts at a time, by where it acts: values at some vertices, all components.
using Values = std::vector<std::pair<std::string, std::vector<double>>>;

template <int Dim> Values values_of(const Acting<Dim>& acting, const Points<Dim>& at) {
  Values values;
  const auto add = [&](const std::string& name, const auto& of) {  // of: a number or a vector, by position
    std::vector<double>& here = values.emplace_back(name, std::vector<double>()).second;
    for (Index k = 0; k < at.cols(); ++k) {
      const Eigen::VectorXd value = Eigen::VectorXd(of(Vec<Dim>(at.col(k))));
      here.insert(here.end(), value.begin(), value.end());
    }
  };
  const auto number = [](const ScalarField<Dim>& field) {
    return [&field](const Vec<Dim>& x) { return Vec<1>(field(x)); };
  };
  for (const DisplacementCondition<Dim>& support : acting.supports) {
    for (const ScalarField<Dim>& component : support.components)
      if (component) add(support.on, number(component));
    if (support.normal) add(support.on, number(support.normal));
  }
  const Vec<Dim> normal = Vec<Dim>::Ones().normalized();
  for (const auto& of : acting.loads.tractions) add(of.on, [&](const Vec<Dim>& x) { return of.traction(x, normal); });
  for (const auto& of : acting.loads.followers) add(of.on, number(of.pressure));
  for (const auto& of : acting.loads.resultants) {
    add(of.on, [&](const Vec<Dim>&) { return of.force; });
    add(of.on, [&](const Vec<Dim>&) { return of.moment; });
  }
  for (const auto& of : acting.loads.mass_forces) add("the body", of.per_mass);
  if (acting.loads.body_force) add("the body", acting.loads.body_force);
  return values;
}

template <int Dim> Points<Dim> some_vertices(const FineMesh<Dim>& mesh, Index most) {
  const Points<Dim>& vertices = mesh.vertices();
  const Index count = std::min<Index>(most, static_cast<Index>(vertices.cols()));
  Points<Dim> at(Dim, count);
  for (Index k = 0; k < count; ++k) at.col(k) = vertices.col(k * (vertices.cols() - 1) / (count - 1));
  return at;
}

/// Whether two are of the same loads: they may come and go.
bool are_alike(const Values& one, const Values& other) {
  return std::ranges::equal(one, other, [](const auto& a, const auto& b) {
    return a.first == b.first && a.second.size() == b.second.size();
  });
}

/// What acts at a time; nothing where an expression has no value.
template <int Dim> Values values_at(const Settings<Dim>& settings, double time, const Points<Dim>& at) {
  try {
    return values_of(settings.time->acting(time), at);
  } catch (const InputError&) {  // the path says so, if it comes there
    return {};
  }
}

/// The largest distance of a load from the straight line between two steps, over its largest value at any step.
struct Distance {
  double distance = 0.0;
  std::string on;
  double from = 0.0, to = 0.0;  ///< the step [time]
};

template <int Dim> Distance largest_distance(const Settings<Dim>& settings, const FineMesh<Dim>& mesh,
                                             const std::vector<double>& times, double from = 0.0) {
  const Points<Dim> at = some_vertices(mesh, vertices_of_distances);
  const auto there = [&](double time) { return values_at(settings, time, at); };
  Values before = there(from);
  std::vector<double> largest(before.size(), 0.0);
  std::vector<Distance> distances(before.size());
  for (const double to : times) {
    const Values after = there(to);
    for (int k = 1; k < times_in_step; ++k) {
      double whole = 0.0;
      const double share = std::modf(k * golden, &whole);  // even ones may all meet zeros of a sine
      const Values now = there(from + share * (to - from));
      if (now.size() != distances.size() || !are_alike(now, before) || !are_alike(now, after)) continue;
      for (std::size_t i = 0; i < now.size(); ++i)
        for (std::size_t j = 0; j < now[i].second.size(); ++j) {
          const double value = now[i].second[j], one = before[i].second[j], other = after[i].second[j];
          const double off = std::abs(value - one - share * (other - one));
          if (!std::isfinite(off)) continue;
          largest[i] = std::max({largest[i], std::abs(value), std::abs(other)});
          if (off > distances[i].distance) distances[i] = {off, now[i].first, from, to};
        }
    }
    before = after;
    from = to;
  }
  Distance most;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    if (!(largest[i] > 0.0)) continue;
    distances[i].distance /= largest[i];
    if (distances[i].distance > most.distance) most = distances[i];
  }
  return most;
}

/// Whether a path would miss what loads do between its steps: they change with time, and materials flow.
template <int Dim> bool may_turn(const Settings<Dim>& settings) {
  return settings.time && settings.time->acting && settings.time->path.control == Control::load &&
         !is_elastic(settings.common.model);
}

/// Of what turns are found from: values at even times, over their largest.
using Signal = std::vector<double>;

template <int Dim>
std::vector<Signal> signals_of(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, int intervals) {
  const Points<Dim> at = some_vertices(mesh, vertices_looked_at);
  std::vector<Signal> signals;
  std::vector<std::pair<std::size_t, std::size_t>> groups;  // of signals that act together
  const Values first_values = values_at(settings, 0.0, at);
  for (const auto& [on, values] : first_values) {
    groups.emplace_back(signals.size(), signals.size() + values.size());
    signals.resize(signals.size() + values.size());
  }
  for (int j = 0; j <= intervals; ++j) {
    const Values now = values_at(settings, settings.time->path.end * j / intervals, at);
    if (!are_alike(now, first_values)) break;
    std::size_t k = 0;
    for (const auto& [on, values] : now)
      for (const double value : values) signals[k++].push_back(value);
  }
  for (const auto& [first, last] : groups) {
    double largest = 0.0;
    for (std::size_t k = first; k < last; ++k)
      for (const double value : signals[k]) largest = std::max(largest, std::abs(value));
    for (std::size_t k = first; k < last; ++k)
      for (double& value : signals[k]) value /= largest;
  }
  std::erase_if(signals, [](const Signal& signal) {
    return !std::ranges::all_of(signal, [](double value) { return std::isfinite(value); });
  });
  return signals;
}

/// Where the lines through two values before and two after the j-th meet, if that is within an interval of it.
std::optional<double> meeting_near(const Signal& f, int j) {
  const int last = static_cast<int>(f.size()) - 1;
  if (j < 2 || j > last - 2) return {};
  const double before = f[j - 1] - f[j - 2], after = f[j + 2] - f[j + 1];
  const double x = j + (f[j + 1] - f[j - 1] - before - after) / (before - after);
  return std::abs(x - j) <= 1.0 ? std::optional(x) : std::nullopt;
}

/// Where a signal has extremes, but for ripples, and kinks [intervals].
std::vector<double> turns_of(const Signal& f) {
  constexpr double ripple = 2e-3;             // of extremes
  constexpr double least_kink = 0.05;         // change of the slope, over that of the largest value in the whole time
  constexpr double kink_to_curvature = 10.0;  // change of the slope over its changes nearby; 3 where all is smooth
  std::vector<double> turns;
  const int last = static_cast<int>(f.size()) - 1;
  int extreme = 0, direction = 0;
  for (int j = 1; j <= last; ++j) {
    const double beyond = f[j] - f[extreme];
    if (direction * beyond > 0.0 || (direction == 0 && std::abs(beyond) <= ripple)) {
      if (direction != 0) extreme = j;
    } else if (std::abs(beyond) > ripple) {
      if (direction != 0) turns.push_back(meeting_near(f, extreme).value_or(extreme));
      direction = beyond > 0.0 ? 1 : -1;
      extreme = j;
    }
  }
  for (int j = 3; j <= last - 3; ++j) {
    const auto slope = [&](int k) { return f[k] - f[k - 1]; };
    const double change = std::abs(slope(j + 2) - slope(j - 1));
    const double nearby = std::max(std::abs(slope(j - 1) - slope(j - 2)), std::abs(slope(j + 3) - slope(j + 2)));
    if (change * last < least_kink || change < kink_to_curvature * nearby) continue;
    if (const auto x = meeting_near(f, j); x && std::abs(*x - j) <= 0.5 + 1e-6) turns.push_back(*x);
  }
  return turns;
}

/// Times of steps of a length and of stops, up to an end.
std::vector<double> even_times(std::vector<double> times, double step, double end) {
  for (double time = step; time < end; time += step) times.push_back(time);
  times.push_back(end);
  std::ranges::sort(times);
  times.erase(std::ranges::upper_bound(times, end), times.end());
  return times;
}

}  // namespace

template <int Dim> std::vector<double> turning_times(const Settings<Dim>& settings, const FineMesh<Dim>& mesh) {
  if (!may_turn(settings)) return {};
  const PathOptions& path = settings.time->path;
  const auto intervals = static_cast<int>(std::clamp(times_in_step * path.end / path.largest_step(), 160.0, 1600.0));
  std::vector<double> turns;
  for (const Signal& signal : signals_of(settings, mesh, intervals))
    for (const double x : turns_of(signal)) turns.push_back(x);
  std::ranges::sort(turns);
  std::vector<double> times;
  for (const double x : turns) {
    const double time = path.end * x / intervals;
    if (times.empty() || time > times.back() + 0.5 * path.end / intervals) times.push_back(time);
  }
  return times;
}

template <int Dim>
double factor_by_turning_loads(const Settings<Dim>& settings, const Result<Dim>& result, double least) {
  if (!may_turn(settings)) return 1.0;
  std::vector<double> times = times_of(result);
  const double end = times.back(), step = settings.time->path.largest_step();
  std::vector<double> stops = turning_times(settings, *result.mesh);
  stops.insert(stops.end(), settings.time->path.stops.begin(), settings.time->path.stops.end());
  const auto worst = [&] { return largest_distance(settings, *result.mesh, times); };
  Distance most = worst();
  if (most.distance < bearable_distance) return 1.0;
  // A jump stays one in the smallest steps: these are looked at where it is, before all others.
  std::vector<double> smallest;
  for (double time = most.from + least * step; time < most.to; time += least * step) smallest.push_back(time);
  smallest.push_back(most.to);
  if (largest_distance(settings, *result.mesh, smallest, most.from).distance >= bearable_distance) return 1.0;
  double factor = 1.0;
  while (most.distance >= bearable_distance) {
    factor *= 0.5;
    if (factor < least) return 1.0;
    times = even_times(stops, factor * step, end);
    most = worst();
  }
  return factor;
}

template <int Dim> void warn_of_turning_loads(const Settings<Dim>& settings, Result<Dim>& result) {
  if (!may_turn(settings)) return;
  const Distance most = largest_distance(settings, *result.mesh, times_of(result));
  if (most.distance < bearable_distance) return;
  result.warnings.push_back(fmt::format(
      "displacements, forces and stresses may be off by any amount: what acts on \"{}\" turns within a step, from time "
      "{:.6g} to {:.6g}, by {:.2g} % of its largest value, and materials flow; use smaller steps ([time] max_step), or "
      "stops where it jumps",
      most.on, most.from, most.to, 100.0 * most.distance));
}

template std::vector<double> turning_times<2>(const Settings<2>&, const FineMesh<2>&);
template std::vector<double> turning_times<3>(const Settings<3>&, const FineMesh<3>&);
template double factor_by_turning_loads<2>(const Settings<2>&, const Result<2>&, double);
template double factor_by_turning_loads<3>(const Settings<3>&, const Result<3>&, double);
template void warn_of_turning_loads<2>(const Settings<2>&, Result<2>&);
template void warn_of_turning_loads<3>(const Settings<3>&, Result<3>&);

}  // namespace efree::internal
