// SPDX-License-Identifier: GPL-3.0-or-later
/// Sizes of steps that the settings leave open.
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// What errors by the size of steps are to become where these are made smaller, how many steps that may take, and the
/// factor of steps below which it is worth another path.
constexpr double aimed_error_of_steps = 0.8 * bearable_error_of_steps, most_steps = 1000.0, worth_it = 0.8;

template <int Dim> double longest_step(const Result<Dim>& result) {
  double longest = 0.0, before = 0.0;
  for (const auto& step : result.history) longest = std::max(longest, step.time - std::exchange(before, step.time));
  return longest;
}

}  // namespace

template <int Dim>
std::optional<SmallerSteps> smaller_steps_for(const Settings<Dim>& settings, const Result<Dim>& result) {
  const TimeSettings<Dim> time = settings.time ? *settings.time : TimeSettings<Dim>();
  const PathOptions& path = time.path;
  // Where a path stops is found by halving steps.
  if (path.gives_steps() || result.history.empty() || !result.stopped.empty() || !settings.estimated)
    return std::nullopt;
  if (const double range = result.elastic_range; range < time.elastic_range)
    return SmallerSteps{
        1.0, range,
        fmt::format("loads turn within them, and {:.2g} % of the largest make materials flow", 100.0 * range)};
  const auto& errors = result.path_errors;
  if (!errors || errors->steps <= bearable_error_of_steps || errors->largest().first <= bearable_error_of_path)
    return std::nullopt;
  const double longest = longest_step(result), steps = static_cast<double>(result.history.size());
  const double factor = std::max({aimed_error_of_steps / errors->steps, steps / most_steps, path.min_step / longest});
  if (factor >= worth_it) return std::nullopt;
  return SmallerSteps{factor * longest / path.largest_step(), time.elastic_range,
                      fmt::format("errors by their size are {:.2g} %", 100.0 * errors->steps)};
}

template <int Dim> Settings<Dim> with_steps_of_checkpoint(Settings<Dim> settings) {
  const auto& from = settings.steps.from;
  if (!from || (from->scale == 1.0 && from->elastic_range == 1.0)) return settings;
  if (!settings.time) {
    settings.time.emplace();
    settings.regime = Regime::finite;  // as materials flow
  }
  if (settings.time->path.gives_steps()) return settings;
  settings.time->path.scale = from->scale;
  settings.time->elastic_range = from->elastic_range;
  return settings;
}

template <int Dim> Settings<Dim> with_smaller_steps(Settings<Dim> settings, const Result<Dim>& result,
                                                    const SmallerSteps& smaller, const Monitor& monitor) {
  if (!settings.time) {
    settings.time.emplace();
    settings.regime = result.regime;
  }
  settings.time->path.scale *= smaller.factor;
  settings.time->elastic_range = smaller.elastic_range;
  settings.steps.from.reset();
  if (monitor.say)
    monitor.say(fmt::format("steps: the path begins again with smaller steps, up to {:.3g} long, as {}",
                            settings.time->path.largest_step(), smaller.why));
  return settings;
}

#define EFREE_INSTANTIATE(Dim)                                                                      \
  template std::optional<SmallerSteps> smaller_steps_for(const Settings<Dim>&, const Result<Dim>&); \
  template Settings<Dim> with_steps_of_checkpoint(Settings<Dim>);                                   \
  template Settings<Dim> with_smaller_steps(Settings<Dim>, const Result<Dim>&, const SmallerSteps&, const Monitor&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
