// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of paths through time by a coarser cloud.
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/assembly/follower_pressure.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <string>

namespace efree::internal {
namespace {

/// Spacing of the coarser cloud over that of the other, and the least that its nodes have to come to: walls and small
/// bodies have theirs whatever the spacing.
constexpr double coarsening = 1.5, least_coarsening = 1.15;
/// With what power of the spacing errors fall: between what linear functions do around corners and where all is smooth.
constexpr double order = 1.5;

/// The same path by a coarser cloud, which stops wherever the other has.
template <int Dim> Settings<Dim> coarser(const Settings<Dim>& settings, const Result<Dim>& result) {
  Settings<Dim> other = settings;
  other.estimated = other.corrected = false;
  other.regime = result.regime;
  other.model = result.model;
  other.steps = {};
  other.approximation.interpolation = result.approximation.space.degree();
  other.approximation.grading.scale *= coarsening;
  if (!other.time) other.time.emplace();
  if (result.regime == Regime::linear) {
    other.loads = at_rest(std::move(other.loads));
    if (auto& acting = other.time->acting)
      acting = [all = std::move(acting)](double time) {
        Acting<Dim> then = all(time);
        then.loads = at_rest(std::move(then.loads));
        return then;
      };
  }
  auto& stops = other.time->path.stops;
  stops.clear();
  for (const auto& step : result.history) stops.push_back(step.time);
  other.time->until.reset();
  other.time->path.until = [last = stops.back()](const PathStep& step) { return step.now.state.time >= last; };
  return other;
}

/// The largest lengths of differences, by what one step has of it and the other.
class Difference {
 public:
  void add(double off, double size) {
    off_ = std::max(off_, off);
    size_ = std::max(size_, size);
  }
  double size() const { return size_; }
  /// Over the largest size, or `least`.
  double relative(double least) const {
    const double size = std::max(size_, least);
    return size > 0.0 ? off_ / size : 0.0;
  }

 private:
  double off_ = 0.0, size_ = 0.0;
};

/// These differences, times a factor.
std::map<std::string, double> relative(const std::map<std::string, Difference>& differences, double factor) {
  constexpr double small = 0.01;  // of the largest
  double most = 0.0;
  for (const auto& [name, one] : differences) most = std::max(most, one.size());
  std::map<std::string, double> errors;
  for (const auto& [name, one] : differences) errors[name] = factor * one.relative(small * most);
  return errors;
}

}  // namespace

template <int Dim>
std::string estimate_path(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (!result.stopped.empty()) return "and the path has no end to compare a coarser cloud's with";
  if (settings.time && settings.time->path.control == Control::arc_length)
    return "and by arc length another cloud goes through other times";
  const Stage stage("coarser cloud", monitor);
  Result<Dim> other;
  other.mesh = result.mesh;
  other.model = result.model;
  try {
    const Settings<Dim> of_other = coarser(settings, result);
    approximate_once(of_other, other, stage.within());
    PathErrors errors;
    errors.coarser = std::pow(
        static_cast<double>(result.approximation.nodes.cols()) / static_cast<double>(other.approximation.nodes.cols()),
        1.0 / Dim);
    if (errors.coarser < least_coarsening)
      return fmt::format("and a coarser cloud has {} nodes for {}", other.approximation.nodes.cols(),
                         result.approximation.nodes.cols());
    answer_by_steps(of_other, other, stage.within());
    const double factor = 1.0 / (std::pow(errors.coarser, order) - 1.0);
    Difference work;
    std::map<std::string, Difference> reactions, probes;
    auto there = other.history.begin();
    for (const HistoryStep<Dim>& step : result.history) {
      while (there != other.history.end() && there->time < step.time) ++there;
      if (there == other.history.end() || there->time != step.time) break;
      errors.until = step.time;
      const double spent = step.stored + step.dissipated;
      work.add(std::abs(spent - there->stored - there->dissipated), spent);
      for (const auto& [name, of] : step.reactions)
        reactions[name].add((of.force - there->reactions.at(name).force).norm(), of.force.norm());
      for (std::size_t k = 0; k < step.probes.size(); ++k)
        probes[settings.probes[k].name].add((step.probes[k] - there->probes[k]).norm(), step.probes[k].norm());
    }
    if (errors.until == 0.0)
      return fmt::format("and a coarser cloud did not come to time {:.6g}", result.history.front().time);
    errors.work = factor * work.relative(0.0);
    errors.reactions = relative(reactions, factor);
    errors.probes = relative(probes, factor);
    result.path_errors = std::move(errors);
    return {};
  } catch (const InputError& error) {
    return fmt::format("and a coarser cloud cannot be: {}", error.what());
  } catch (const NumericalError& error) {
    return fmt::format("and a coarser cloud does not go that way: {}", error.what());
  }
}

template std::string estimate_path<2>(const Settings<2>&, Result<2>&, const Monitor&);
template std::string estimate_path<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
