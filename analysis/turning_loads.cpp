// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads that change within steps in ways that steps do not see.
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Times within a step, and vertices of the mesh, at which loads are looked at.
constexpr int times_in_step = 16;
constexpr Index vertices_looked_at = 5;
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

/// The largest distance of a load from the straight line between two steps, over its largest value at any step.
struct Distance {
  double distance = 0.0;
  std::string on;
  double from = 0.0, to = 0.0;  ///< the step [time]
};

template <int Dim>
Distance largest_distance(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, const std::vector<double>& times) {
  const Points<Dim>& vertices = mesh.vertices();
  Points<Dim> at(Dim, vertices_looked_at);
  for (Index k = 0; k < vertices_looked_at; ++k)
    at.col(k) = vertices.col(k * (vertices.cols() - 1) / (vertices_looked_at - 1));
  const auto there = [&](double time) { return values_of(settings.time->acting(time), at); };
  Values before = there(0.0);
  std::vector<double> largest(before.size(), 0.0);
  std::vector<Distance> distances(before.size());
  double from = 0.0;
  for (const double to : times) {
    const Values after = there(to);
    for (int k = 1; k < times_in_step; ++k) {
      const double share = static_cast<double>(k) / times_in_step;
      const Values now = there(from + share * (to - from));
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

/// Times of steps of a length and of the stops of a path, up to an end.
std::vector<double> even_times(const PathOptions& path, double step, double end) {
  std::vector<double> times = path.stops;
  for (double time = step; time < end; time += step) times.push_back(time);
  times.push_back(end);
  std::ranges::sort(times);
  times.erase(std::ranges::upper_bound(times, end), times.end());
  return times;
}

}  // namespace

template <int Dim>
double factor_by_turning_loads(const Settings<Dim>& settings, const Result<Dim>& result, double least) {
  if (!may_turn(settings)) return 1.0;
  std::vector<double> times = times_of(result);
  const double end = times.back(), step = settings.time->path.largest_step();
  double factor = 1.0;
  while (largest_distance(settings, *result.mesh, times).distance >= bearable_distance) {
    factor *= 0.5;
    if (factor < least) return 1.0;
    times = even_times(settings.time->path, factor * step, end);
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
      "stops where it turns",
      most.on, most.from, most.to, 100.0 * most.distance));
}

template double factor_by_turning_loads<2>(const Settings<2>&, const Result<2>&, double);
template double factor_by_turning_loads<3>(const Settings<3>&, const Result<3>&, double);
template void warn_of_turning_loads<2>(const Settings<2>&, Result<2>&);
template void warn_of_turning_loads<3>(const Settings<3>&, Result<3>&);

}  // namespace efree::internal
