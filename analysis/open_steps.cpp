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
  const double least = least_scale / path.scale;
  if (path.gives_steps() || result.history.empty() || !settings.estimated || least >= 1.0) return {};
  if (const double factor = factor_by_turning_loads(settings, result, least); factor < 1.0)
    return {factor, "loads turn within them"};
  const auto& errors = result.path_errors;
  if (!errors || errors->steps <= bearable_error_of_steps || errors->largest().first <= bearable_error_of_path)
    return {};
  return {std::max(aimed_error_of_steps / errors->steps, least),
          fmt::format("errors by their size are {:.2g} %", 100.0 * errors->steps)};
}

template <int Dim> Settings<Dim> with_steps_of_checkpoint(Settings<Dim> settings) {
  if (!settings.steps.from || settings.steps.from->scale == 1.0) return settings;
  if (!settings.time) {
    settings.time.emplace();
    settings.regime = Regime::finite;  // as materials flow
  }
  if (!settings.time->path.gives_steps()) settings.time->path.scale = settings.steps.from->scale;
  return settings;
}

template <int Dim> Settings<Dim> with_smaller_steps(Settings<Dim> settings, const Result<Dim>& result,
                                                    const SmallerSteps& smaller, const Monitor& monitor) {
  if (!settings.time) {
    settings.time.emplace();
    settings.regime = result.regime;
  }
  settings.time->path.scale *= smaller.factor;
  settings.steps.from.reset();
  if (monitor.say)
    monitor.say(
        fmt::format("steps: the path begins again with steps up to {:.3g} long, {:.2g} times as long as before, "
                    "as {}",
                    settings.time->path.largest_step(), smaller.factor, smaller.why));
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
