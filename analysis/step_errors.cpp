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

/// Least steps of a path with smaller ones over those of the path.
constexpr double least_more = 1.25;
/// Part of what a path dissipates from which on the coarsest one is taken to tell of errors by the size of steps, and
/// least part of that of any; below that part of the work nobody sees them.
constexpr double enough_flow = 0.5, least_flow = 0.3, unseen_flow = 1e-3;

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

/// A path again, on the same cloud or mesh and with twice as many steps: larger ones would pass over what loads do.
template <int Dim>
Result<Dim> with_half_steps(const Settings<Dim>& settings, const Result<Dim>& path, const Monitor& monitor) {
  Settings<Dim> other = same_path(settings, path);
  PathOptions& options = other.time->path;
  if (options.control == Control::arc_length) {
    options.scale *= 0.5;
    options.max_steps *= 2;
  } else {
    options.stops = with_middles(times_of(path));
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
        other_(curves_of(settings, other)),
        period_(period_of(path_.work)) {}
  double work() const { return of(path_.work, other_.work, path_.work.largest); }
  double dissipated() const { return of(path_.dissipated, other_.dissipated, path_.dissipated.largest); }
  std::map<std::string, double> by_name(std::map<std::string, Curve> Curves::*kind) const {
    std::map<std::string, double> result;
    for (const auto& [name, size] : sizes_of(path_.*kind))
      result[name] = of((path_.*kind).at(name), (other_.*kind).at(name), size);
    return result;
  }

 private:
  double of(const Curve& path, const Curve& other, double size) const {
    if (!(size > 0.0)) return 0.0;
    if (!by_arc_) return difference_in_time(path, other) / size;
    return distance_of_curves(path, other, period_, size);
  }

  bool by_arc_;
  Curves path_, other_;
  double period_;
};

/// Adds the errors that a path `like` the result has by the size of its steps. Why they are not known; nothing where
/// they are.
template <int Dim> std::string compare_steps(const Settings<Dim>& settings, const Result<Dim>& like,
                                             Result<Dim>& result, const Monitor& monitor) {
  if (!(like.history.back().dissipated > least_flow * result.history.back().dissipated))
    return "materials of a coarser path hardly flow";
  const Result<Dim> other = with_half_steps(settings, like, monitor);
  const auto steps = static_cast<double>(like.history.size());
  const double more = static_cast<double>(other.history.size()) / steps;
  if (more < least_more) return "smaller steps end before";
  // Of steps of size h and of h / `more` that the difference is (1 - 1 / more) times the error by h.
  const double factor = steps / result.history.size() / (1.0 - 1.0 / more);
  const Differences<Dim> differences(settings, like, other);
  PathErrors& errors = *result.path_errors;
  const auto add = [&](double difference, double& error) {
    error += factor * difference;
    errors.steps = std::max(errors.steps, factor * difference);
  };
  add(differences.work(), errors.work);
  for (auto [kind, of] : {std::pair(&Curves::reactions, &errors.reactions), {&Curves::probes, &errors.probes}})
    for (const auto& [name, difference] : differences.by_name(kind)) add(difference, of->at(name));
  errors.dissipated += factor * differences.dissipated();
  const double end = like.history.back().time, end_of_other = other.history.back().time;
  if (errors.limit) add(std::abs(end - end_of_other) / std::abs(end), *errors.limit);
  if (errors.stress && end == end_of_other) *errors.stress += factor * difference_of_stresses(like, other);
  return {};
}

}  // namespace

template <int Dim> void add_errors_of_steps(const Settings<Dim>& settings, const Result<Dim>& coarser,
                                            const Result<Dim>* coarsest, Result<Dim>& result, const Monitor& monitor) {
  const HistoryStep<Dim>& last = result.history.back();
  if (is_elastic(result.model) || !(last.dissipated > unseen_flow * (last.stored + last.dissipated))) return;
  const bool flows = coarsest && coarsest->history.back().dissipated > enough_flow * last.dissipated;
  const Stage stage("smaller steps", monitor);
  std::string why;
  try {
    why = compare_steps(settings, flows ? *coarsest : coarser, result, stage.within());
  } catch (const InputError& error) {
    why = error.what();
  } catch (const NumericalError& error) {
    why = error.what();
  }
  if (why.empty()) return;
  result.warnings.push_back(
      fmt::format("displacements, forces and stresses may be further off than their errors say: materials flow, and "
                  "errors by the size of the steps are not known ({}); compare steps of two sizes ([time] step)",
                  why));
}

template void add_errors_of_steps<2>(const Settings<2>&, const Result<2>&, const Result<2>*, Result<2>&,
                                     const Monitor&);
template void add_errors_of_steps<3>(const Settings<3>&, const Result<3>&, const Result<3>*, Result<3>&,
                                     const Monitor&);

}  // namespace efree::internal
