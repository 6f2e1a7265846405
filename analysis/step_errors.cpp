// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of load paths by the size of their steps.
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/equations/locking.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree::internal {
namespace {

/// Steps of a path over those of one with larger ones, and with smaller ones, within which errors by the size of steps
/// are not told from others: steps that do not converge are halved.
constexpr double least_more = 1.25, most_fewer = 0.8;

/// Every second one of the times of a path, and those at which loads turn.
std::vector<double> every_second(const std::vector<double>& times, const std::vector<double>& turns) {
  std::vector<double> result;
  bool next = true;
  for (std::size_t k = times.size(); k-- > 0;) {
    const bool turn = std::ranges::find(turns, times[k]) != turns.end();
    if (next || turn) result.push_back(times[k]);
    next = turn ? false : !next;
  }
  std::ranges::reverse(result);
  return result;
}

/// Those of a path, and one in the middle of each of its steps.
std::vector<double> with_middles(const std::vector<double>& times) {
  std::vector<double> result;
  for (double before = 0.0; const double time : times) {
    result.push_back(0.5 * (before + time));
    result.push_back(time);
    before = time;
  }
  return result;
}

/// A path again, on the same cloud or mesh and with other steps.
template <int Dim>
Result<Dim> with_steps(const Settings<Dim>& settings, const Result<Dim>& path, bool larger, const Monitor& monitor) {
  Settings<Dim> other = same_path(settings, path);
  PathOptions& options = other.time->path;
  if (options.min_step == 0.0) options.min_step = 1e-3 * options.step;
  if (options.control == Control::arc_length) {
    const double largest = options.max_step > 0.0 ? options.max_step : std::max(options.step, 0.1 * options.end);
    options.step *= larger ? 2.0 : 0.5;
    options.max_step = larger ? 2.0 * largest : 0.5 * largest;
  } else {
    const std::vector<double> times = times_of(path);
    options.stops = larger ? every_second(times, settings.time ? settings.time->path.stops : std::vector<double>())
                           : with_middles(times);
    options.step = options.max_step = options.end;
  }
  Result<Dim> result;
  result.mesh = path.mesh;
  result.model = path.model;
  result.approximation = path.approximation;
  answer_by_steps<Dim>(other, nullptr, result, monitor);
  return result;
}

/// Differences of values between a path and the same with other steps, over their largest.
template <int Dim> class Differences {
 public:
  Differences(const Settings<Dim>& settings, const Result<Dim>& path, const Result<Dim>& other)
      : by_arc_(settings.time && settings.time->path.control == Control::arc_length),
        path_(curves_of(settings, path)),
        other_(curves_of(settings, other)) {
    for (const double time : path_.work.times) period_ = std::max(period_, std::abs(time));
  }
  double work() const { return of(path_.work, other_.work, path_.work.largest); }
  /// By name; of a hundredth of the largest of their kind if that is more.
  std::map<std::string, double> by_name(std::map<std::string, Curve> Curves::*kind) const {
    std::map<std::string, double> result;
    double most = 0.0;
    for (const auto& [name, curve] : path_.*kind) most = std::max(most, curve.largest);
    for (const auto& [name, curve] : path_.*kind)
      result[name] = of(curve, (other_.*kind).at(name), std::max(curve.largest, small_value * most));
    return result;
  }

 private:
  /// Steps along an arc are compared with the path that has more of them, which is nearer to straight between two.
  double of(const Curve& path, const Curve& other, double size) const {
    if (!(size > 0.0)) return 0.0;
    if (!by_arc_) return difference_in_time(path, other) / size;
    return path.times.size() > other.times.size() ? distance_of_curves(other, path, period_, size)
                                                  : distance_of_curves(path, other, period_, size);
  }

  bool by_arc_;
  Curves path_, other_;
  double period_ = 0.0;
};

}  // namespace

template <int Dim> void add_errors_of_steps(const Settings<Dim>& settings, const Result<Dim>& coarser,
                                            Result<Dim>& result, const Monitor& monitor) {
  if (!result.path_errors) return;
  PathErrors& errors = *result.path_errors;
  errors.space = errors.largest().first;
  if (is_elastic(result.model) || !(coarser.history.back().dissipated > 0.0)) return;
  const Stage stage("other steps", monitor);
  std::string why = "paths of other steps take as many";
  try {
    const auto more_than = [&](const Result<Dim>& other) {
      return static_cast<double>(coarser.history.size()) / static_cast<double>(other.history.size());
    };
    std::optional<Result<Dim>> other;
    if (coarser.history.size() > 1) other.emplace(with_steps(settings, coarser, true, stage.within()));
    if (!other || more_than(*other) < least_more) other.emplace(with_steps(settings, coarser, false, stage.within()));
    const double more = more_than(*other);
    if (more >= least_more || more <= most_fewer) {
      // Of steps of size h and those of `more` times that the difference is (more - 1) h times the error by h.
      const double factor =
          static_cast<double>(coarser.history.size()) / (std::abs(more - 1.0) * result.history.size());
      const Differences<Dim> differences(settings, coarser, *other);
      const auto add = [&](double difference, double& error) {
        error += factor * difference;
        errors.steps = std::max(errors.steps, factor * difference);
      };
      add(differences.work(), errors.work);
      for (auto [kind, of] : {std::pair(&Curves::reactions, &errors.reactions), {&Curves::probes, &errors.probes}})
        for (const auto& [name, difference] : differences.by_name(kind)) add(difference, of->at(name));
      const double end = coarser.history.back().time, end_of_other = other->history.back().time;
      if (errors.limit) add(std::abs(end - end_of_other) / std::abs(end), *errors.limit);
      if (errors.stress && end == end_of_other) *errors.stress += factor * difference_of_stresses(coarser, *other);
      return;
    }
  } catch (const InputError& error) {
    why = error.what();
  } catch (const NumericalError& error) {
    why = error.what();
  }
  result.warnings.push_back(
      fmt::format("displacements, forces and stresses may be further off than their errors say: materials flow, and "
                  "errors by the size of the steps are not known ({}); compare steps of two sizes ([time] step)",
                  why));
}

template void add_errors_of_steps<2>(const Settings<2>&, const Result<2>&, Result<2>&, const Monitor&);
template void add_errors_of_steps<3>(const Settings<3>&, const Result<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
