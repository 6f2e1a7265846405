// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads that turn within the steps of a path.
#include "efree/analysis/internal/load_curve.hpp"
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// The least steps that turning loads ask for, over the largest that the settings take.
constexpr double least_part = 1.0 / 64.0;
/// The least swings that count, over the largest load.
constexpr double ripple = 2e-3;

/// Whether a path would miss what loads do between its steps: they change with time, and materials flow.
template <int Dim> bool may_turn(const Settings<Dim>& settings) {
  return settings.time && settings.time->acting && settings.time->path.control == Control::load &&
         !is_elastic(settings.common.model);
}

/// By how much loads may leave the straight line within a step: a quarter of what bodies bear elastically, and no more
/// than a twentieth of the largest load.
double bearable_deviation(double elastic_range) {
  return std::min(0.05, 0.25 * elastic_range);
}

/// How well the curve of loads has to be known for that.
double tolerance_for(double elastic_range) {
  return std::min(0.5 * ripple, 0.25 * bearable_deviation(elastic_range));
}

template <int Dim>
LoadCurve<Dim> curve_of(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, double elastic_range) {
  const PathOptions& path = settings.time->path;
  const auto least = static_cast<int>(std::clamp(16.0 * path.end / path.largest_step(), 160.0, 1600.0));
  return {settings, mesh, least, tolerance_for(elastic_range)};
}

/// Ends of steps between which loads are nearly straight, if steps that may be as long as the settings say and end at
/// these stops are not enough; else the stops. Loads that turn by less than what is bearable are followed in eighths of
/// a full turn, too.
template <int Dim> std::vector<double> nearly_straight(const LoadCurve<Dim>& curve, const PathOptions& path,
                                                       double bearable, std::vector<double> stops) {
  constexpr double of_chord = 0.1;
  const double largest = path.largest_step(), least = std::max(least_part * largest, path.min_step), end = path.end;
  const auto is_straight = [&](double from, double to) {
    const Deviation off = curve.deviation(from, to);
    return off.distance <= bearable && (off.distance <= ripple || off.distance <= of_chord * off.change);
  };
  std::vector<double> ends;
  bool is_cut = false;
  auto stop = stops.begin();
  for (double from = 0.0; from < end * (1.0 - 1e-9);) {
    while (stop != stops.end() && *stop <= from) ++stop;
    double to = std::min({from + largest, end, stop != stops.end() ? *stop : end});
    while (to - from >= 2.0 * least && !is_straight(from, to)) {
      to = 0.5 * (from + to);
      is_cut = true;
    }
    ends.push_back(to);
    from = to;
  }
  return is_cut ? ends : stops;
}

/// Between which steps of a path loads leave the straight line most, by how much, and which.
struct Turn {
  double from = 0.0, to = 0.0;
  Deviation by{};
};
template <int Dim> Turn worst_turn(const LoadCurve<Dim>& curve, const Result<Dim>& result) {
  Turn worst;
  double from = 0.0;
  for (const auto& step : result.history) {
    if (Deviation by = curve.deviation(from, step.time); by.distance > worst.by.distance)
      worst = {from, step.time, std::move(by)};
    from = step.time;
  }
  return worst;
}

/// TimeSettings::elastic_range of a path: twice the energy that it stores at most over its work per change of the
/// loads; `known`, unless it is clearly less. Forces alone are never far beyond what the body bears elastically.
template <int Dim> double elastic_range_of(const LoadCurve<Dim>& curve, double known, const Result<Dim>& result) {
  constexpr double least = 1e-3, clearly = 0.7;
  if (!curve.moves_supports()) return known;
  double from = 0.0, before = 0.0, work = 0.0, change = 0.0, stored = 0.0;
  for (const auto& step : result.history) {
    const double now = step.stored + step.dissipated;
    work += std::abs(now - before);
    change += curve.deviation(from, step.time).change;
    stored = std::max(stored, step.stored);
    before = now;
    from = step.time;
  }
  const double range = std::max(2.0 * stored * change / work, least);
  return range < clearly * known ? range : known;
}

/// A path, its elastic range, and whether the curve of loads is known as well as that asks for.
struct Followed {
  double elastic_range;
  bool is_known;
  Turn worst;
};
template <int Dim> Followed follow(const Settings<Dim>& settings, const Result<Dim>& result) {
  const double known = settings.time->elastic_range;
  const LoadCurve<Dim> curve = curve_of(settings, *result.mesh, known);
  const double range = elastic_range_of(curve, known, result);
  const auto with = [&](const LoadCurve<Dim>& of) {
    return Followed{range, of.is_followed() && of.known_until() >= result.history.back().time, worst_turn(of, result)};
  };
  return tolerance_for(range) == tolerance_for(known) ? with(curve) : with(curve_of(settings, *result.mesh, range));
}

}  // namespace

template <int Dim> std::vector<double> stops_at_turns(const Settings<Dim>& settings, const FineMesh<Dim>& mesh,
                                                      std::vector<double> stops) {
  constexpr double same = 1e-4;  // of the way
  std::ranges::sort(stops);
  if (!may_turn(settings)) return stops;
  const TimeSettings<Dim>& time = *settings.time;
  const double bearable = bearable_deviation(time.elastic_range), least_swing = std::min(ripple, 0.2 * bearable);
  const LoadCurve<Dim> curve = curve_of(settings, mesh, time.elastic_range);
  if (!curve.is_followed()) return stops;  // turns would be those of samples
  std::vector<double> all = stops;
  for (const double turn : curve.turns(least_swing)) {
    const auto next = std::ranges::lower_bound(stops, turn - same * time.path.end);
    if (next == stops.end() || *next > turn + same * time.path.end) all.push_back(turn);
  }
  for (const auto& [before, after] : curve.jumps(least_swing)) all.insert(all.end(), {before, after});
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return time.path.gives_steps() ? all : nearly_straight(curve, time.path, bearable, std::move(all));
}

template <int Dim> void check_turning_loads(const Settings<Dim>& settings, Result<Dim>& result) {
  if (!may_turn(settings)) return;
  const auto& [range, is_known, worst] = follow(settings, result);
  const auto& [from, to, by] = worst;
  result.elastic_range = settings.time->elastic_range;
  if (by.distance > bearable_deviation(range)) {
    result.elastic_range = range;
    result.warnings.push_back(fmt::format(
        "displacements, forces and stresses may be off by any amount: what acts on \"{}\" turns within a step, from "
        "time {:.6g} to {:.6g}, by {:.2g} % of its largest value, and materials flow; use smaller steps ([time] "
        "max_step), or stops where it turns",
        by.on, from, to, 100.0 * by.distance));
  } else if (!is_known) {
    result.warnings.push_back(
        "displacements, forces and stresses may be off by any amount: loads turn more often than could be followed, "
        "and materials flow; compare two sizes of steps ([time] max_step)");
  }
}

template std::vector<double> stops_at_turns<2>(const Settings<2>&, const FineMesh<2>&, std::vector<double>);
template std::vector<double> stops_at_turns<3>(const Settings<3>&, const FineMesh<3>&, std::vector<double>);
template void check_turning_loads<2>(const Settings<2>&, Result<2>&);
template void check_turning_loads<3>(const Settings<3>&, Result<3>&);

}  // namespace efree::internal
