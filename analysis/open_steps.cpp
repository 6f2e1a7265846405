// SPDX-License-Identifier: GPL-3.0-or-later
/// Sizes of steps that the settings leave open.
#include "efree/analysis/internal/judge.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// What errors by the size of steps are to become where these are made smaller, and the least part of what steps are by
/// default.
constexpr double aimed_error_of_steps = 0.8 * bearable_error_of_steps, least_scale = 1.0 / 64.0;

}  // namespace

template <int Dim> SmallerSteps smaller_steps_for(const Settings<Dim>& settings, const Result<Dim>& result) {
  const PathOptions path = settings.time ? settings.time->path : PathOptions();
  const double least = std::max(least_scale / path.scale, path.min_step / path.first_step());
  if (path.gives_steps() || result.history.empty() || !settings.estimated || least >= 1.0) return {};
  const double range = settings.time ? settings.time->elastic_range : 1.0;
  if (const double smaller = smaller_elastic_range(settings, result); smaller < range)
    return {1.0, smaller,
            fmt::format("loads turn within them, and {:.2g} % of the largest make materials flow", 100.0 * smaller)};
  const auto& errors = result.path_errors;
  if (!errors || errors->steps <= bearable_error_of_steps || errors->largest().first <= bearable_error_of_path)
    return {};
  return {std::max(aimed_error_of_steps / errors->steps, least), range,
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

#define EFREE_INSTANTIATE(Dim)                                                       \
  template SmallerSteps smaller_steps_for(const Settings<Dim>&, const Result<Dim>&); \
  template Settings<Dim> with_steps_of_checkpoint(Settings<Dim>);                    \
  template Settings<Dim> with_smaller_steps(Settings<Dim>, const Result<Dim>&, const SmallerSteps&, const Monitor&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
