// SPDX-License-Identifier: GPL-3.0-or-later
/// Where a path ends: at the bound of a probe or a reaction.
#pragma once

#include "efree/analysis/settings.hpp"
#include "efree/core/internal/setting_error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <vector>

namespace efree::internal {

/// The end of a path that is told by a probe or a reaction.
template <int Dim> class EndOfPath {
 public:
  /// Throws InputError for a name that the settings do not have.
  EndOfPath(const Settings<Dim>& settings, const PathEnd& end) : end_(end) {
    const bool is_probe = end.of == PathEnd::Of::probe;
    const auto found = std::ranges::find(settings.probes, end.name, &Probe<Dim>::name);
    probe_ = static_cast<std::size_t>(found - settings.probes.begin());
    const bool is_reaction =
        std::ranges::find(settings.reactions, end.name, &Reaction::name) != settings.reactions.end() ||
        std::ranges::find(settings.supports, end.name, &DisplacementCondition<Dim>::on) != settings.supports.end();
    if (is_probe ? found == settings.probes.end() : !is_reaction)
      throw SettingError("time.until",
                         fmt::format("until: there is no {} \"{}\"", is_probe ? "probe" : "reaction", end.name));
  }
  double value(const HistoryStep<Dim>& step) const {
    const Vec<Dim> all =
        end_.of == PathEnd::Of::probe ? step.probes[probe_] : Vec<Dim>(step.reactions.at(end_.name).force);
    return end_.component < 0 ? all.norm() : all[end_.component];
  }
  /// Whether the value comes to a bound if it changes as it has since an earlier step, for ten times as long.
  bool is_near(const HistoryStep<Dim>& earlier, const HistoryStep<Dim>& last) const {
    constexpr double times = 10.0;
    const double now = value(last), later = now + times * (now - value(earlier));
    return (end_.above && later > *end_.above) || (end_.below && later < *end_.below);
  }
  /// Whether the last step is beyond a bound that the beginning or an earlier one was not beyond.
  bool is_passed(const std::vector<HistoryStep<Dim>>& history) const {
    if (history.empty()) return false;
    const auto passed = [&](const auto& is_beyond) {
      return is_beyond(value(history.back())) &&
             (!is_beyond(0.0) ||
              !std::ranges::all_of(history, is_beyond, [&](const auto& step) { return value(step); }));
    };
    return (end_.above && passed([&](double value) { return value > *end_.above; })) ||
           (end_.below && passed([&](double value) { return value < *end_.below; }));
  }

 private:
  PathEnd end_;
  std::size_t probe_ = 0;
};

}  // namespace efree::internal
