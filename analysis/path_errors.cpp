// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of load paths, by comparison with a coarser path.
#include "efree/analysis/internal/path_curves.hpp"
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

namespace efree::internal {
namespace {

/// Spacing of the coarser cloud over that of the other, and the least that its nodes have to come to: walls and small
/// bodies have theirs whatever the spacing.
constexpr double coarsening = 1.5, least_coarsening = 1.15;
/// With what power of the spacing errors of values fall, as assumed and at most: around corners and fronts of flow with
/// 1 to 1.5, by chords of curved boundaries with 2. Quadratic elements reach 4 where all is smooth and straight; meshes
/// too coarse for a corner pretend to.
constexpr double assumed_order = 1.5, most_order = 2.0;

/// Estimated error of a path, from that by the next coarser path and the one before it from the coarser two, both by
/// the assumed order; `ratio` of the spacings of the finer two.
double error_of_three(double now, double before, double ratio, bool alternates) {
  const double growth = std::pow(ratio, assumed_order);
  // Two unstructured meshes may agree by chance: then what the coarser two say is left of it.
  const double error = std::max(now, before / std::pow(ratio, most_order));
  return alternates && now < before ? error * (growth - 1.0) / (growth + 1.0) : error;  // an alternating series
}

/// Spacing of a coarser path over that of another, by their numbers of nodes.
template <int Dim> double spacing_ratio(const Result<Dim>& coarser, const Result<Dim>& other) {
  return std::pow(static_cast<double>(other.approximation.nodes.cols()) / coarser.approximation.nodes.cols(),
                  1.0 / Dim);
}

/// The same path by a coarser cloud, which stops wherever the other has.
template <int Dim> Settings<Dim> coarser(const Settings<Dim>& settings, const Result<Dim>& result) {
  Settings<Dim> other = same_path(settings, result);
  other.common.approximation.interpolation = result.approximation.space.degree();
  other.common.approximation.grading.scale *= coarsening;
  other.time->path.stops = times_of(result);
  return other;
}

/// Whether values alternate from a path to coarser ones: the sum over common times of the products of their differences
/// is negative.
bool alternates(const Curve& curve, const Curve& coarser, const Curve& coarsest) {
  double sum = 0.0;
  for (std::size_t k = 0; k < curve.times.size(); ++k) {
    const Vector* one = value_at(coarser, curve.times[k]);
    const Vector* another = value_at(coarsest, curve.times[k]);
    if (one && another) sum += (curve.values[k] - *one).dot(*one - *another);
  }
  return sum < 0.0;
}

/// The limit load of a path by arc length, of loads proportional to the time.
struct ArcLimit {
  double load;  ///< at the limit [time]
  double rest;  ///< what steps lack of it, relative
};
/// Of a path that passes it the vertex of the parabola through the time as a function of the work at the last step
/// before it falls and that step's neighbours; of one that ends on a plateau its largest load. Nothing of others.
template <int Dim> std::optional<ArcLimit> limit_of_arc(const Result<Dim>& path, const Curve& work) {
  constexpr double rounding = 1e-6;  // of plateaus
  for (std::size_t k = 1; k + 1 < work.times.size(); ++k) {
    if (work.times[k + 1] >= (1.0 - rounding) * work.times[k]) continue;
    const double t = work.times[k], x = work.values[k][0];
    const double left = work.values[k - 1][0] - x, right = work.values[k + 1][0] - x;
    const double slope_left = (work.times[k - 1] - t) / left, slope_right = (work.times[k + 1] - t) / right;
    const double bend = (slope_right - slope_left) / (right - left), slope = slope_left - bend * left;
    const double vertex = left < 0.0 && right > 0.0 && bend < 0.0 ? t - 0.25 * slope * slope / bend : t;
    return ArcLimit{vertex, 1.0 - t / vertex};
  }
  if (const auto plateau = plateau_of(path.history))
    return ArcLimit{*std::ranges::max_element(work.times), plateau->rise};
  return std::nullopt;
}

/// A path and coarser ones of the same settings; the coarsest may be missing.
template <int Dim> class Comparison {
 public:
  Comparison(const Settings<Dim>& settings, const Result<Dim>& result, const Result<Dim>& coarser,
             const Result<Dim>* coarsest)
      : by_arc_(settings.time && settings.time->path.control == Control::arc_length),
        result_(result),
        coarser_(coarser),
        ratio_(spacing_ratio(coarser, result)),
        curves_(curves_of(settings, result)),
        of_coarser_(curves_of(settings, coarser)) {
    period_ = period_of(curves_.work);
    if (by_arc_) {
      until_ = std::min(end_of(result), end_of(coarser));
    } else {
      for (const double time : curves_.work.times)
        if (std::ranges::binary_search(of_coarser_.work.times, time)) until_ = time;
    }
    if (!coarsest) return;
    const double before = spacing_ratio(*coarsest, coarser);
    const bool is_complete = end_of(*coarsest) >= std::min(until_, end_of(coarser)) ||
                             (!coarsest->stopped.empty() && !coarser.stopped.empty());
    if (before < least_coarsening || !is_complete) return;
    coarsest_ = coarsest;
    ratio_before_ = before;
    of_coarsest_ = curves_of(settings, *coarsest);
  }

  double ratio() const { return ratio_; }
  double until() const { return until_; }

  PathErrors errors() const {
    PathErrors errors;
    errors.coarser = ratio_;
    errors.until = until_;
    errors.work = error(curves_.work, of_coarser_.work, coarsest_ ? &of_coarsest_.work : nullptr, curves_.work.largest);
    errors.dissipated = error(curves_.dissipated, of_coarser_.dissipated,
                              coarsest_ ? &of_coarsest_.dissipated : nullptr, curves_.dissipated.largest);
    errors.reactions = errors_by_name(&Curves::reactions);
    errors.probes = errors_by_name(&Curves::probes);
    if (!by_arc_ && !result_.stopped.empty() && !coarser_.stopped.empty())
      errors.limit =
          error_of(end_of(result_), end_of(coarser_),
                   coarsest_ && !coarsest_->stopped.empty() ? std::optional(end_of(*coarsest_)) : std::nullopt);
    if (by_arc_) errors.limit = error_of_arc_limit();
    if (end_of(result_) == end_of(coarser_)) {
      const double now = factor(ratio_) * difference_of_stresses(result_, coarser_);
      const bool with_coarsest = coarsest_ && end_of(*coarsest_) == end_of(coarser_);
      errors.stress =
          with_coarsest
              ? error_of_three(now, factor(ratio_before_) * difference_of_stresses(coarser_, *coarsest_), ratio_, false)
              : now;
    }
    errors.space = errors.largest().first;
    return errors;
  }

 private:
  static double end_of(const Result<Dim>& result) { return result.history.back().time; }
  /// Error over difference, by the assumed order.
  static double factor(double ratio) { return 1.0 / (std::pow(ratio, assumed_order) - 1.0); }

  /// Of single numbers, relative.
  double error_of(double value, double coarser, const std::optional<double>& coarsest) const {
    const double size = std::abs(value), now = factor(ratio_) * std::abs(value - coarser) / size;
    if (!coarsest) return now;
    const double before = factor(ratio_before_) * std::abs(coarser - *coarsest) / size;
    return error_of_three(now, before, ratio_, (value - coarser) * (coarser - *coarsest) < 0.0);
  }

  /// Of the largest load of steps along the arc: by the limits of the paths, and by what steps lack of it.
  std::optional<double> error_of_arc_limit() const {
    const auto limit = limit_of_arc(result_, curves_.work), of_coarser = limit_of_arc(coarser_, of_coarser_.work);
    if (!limit || !of_coarser) return std::nullopt;
    std::optional<double> load_of_coarsest;
    if (coarsest_)
      if (const auto of_coarsest = limit_of_arc(*coarsest_, of_coarsest_.work)) load_of_coarsest = of_coarsest->load;
    return error_of(limit->load, of_coarser->load, load_of_coarsest) + limit->rest;
  }

  double error(const Curve& curve, const Curve& coarser, const Curve* coarsest, double size) const {
    if (size == 0.0) return 0.0;
    const auto difference = [&](const Curve& one, const Curve& other) {
      return by_arc_ ? distance_of_curves(one, other, period_, size) : difference_in_time(one, other) / size;
    };
    const double now = factor(ratio_) * difference(curve, coarser);
    if (!coarsest) return now;
    const double before = factor(ratio_before_) * difference(coarser, *coarsest);
    return error_of_three(now, before, ratio_, !by_arc_ && alternates(curve, coarser, *coarsest));
  }

  std::map<std::string, double> errors_by_name(std::map<std::string, Curve> Curves::*kind) const {
    std::map<std::string, double> errors;
    for (const auto& [name, size] : sizes_of(curves_.*kind))
      errors[name] = error((curves_.*kind).at(name), (of_coarser_.*kind).at(name),
                           coarsest_ ? &(of_coarsest_.*kind).at(name) : nullptr, size);
    return errors;
  }

  bool by_arc_;
  const Result<Dim>&result_, &coarser_;
  const Result<Dim>* coarsest_ = nullptr;
  double ratio_, ratio_before_ = 0.0;
  Curves curves_, of_coarser_, of_coarsest_;
  double period_ = 0.0, until_ = 0.0;
};

/// Puts the errors of the path, by a coarser one of the same settings and, unless it is null, one that is coarser
/// still, into the result. Why they are unknown; nothing where they are known.
template <int Dim> std::string compare_paths(const Settings<Dim>& settings, const Result<Dim>& coarser,
                                             const Result<Dim>* coarsest, Result<Dim>& result, const Monitor& monitor) {
  const Comparison<Dim> comparison(settings, result, coarser, coarsest);
  if (comparison.ratio() < least_coarsening)
    return fmt::format("a coarser path has {} nodes for {}", coarser.approximation.nodes.cols(),
                       result.approximation.nodes.cols());
  if (comparison.until() == 0.0)
    return fmt::format("a coarser path did not reach time {:.6g}", result.history.front().time);
  result.path_errors = comparison.errors();
  add_errors_of_steps(settings, coarser, coarsest, result, monitor);
  return {};
}

}  // namespace

template <int Dim> std::string estimate_path(const Settings<Dim>& settings, const Result<Dim>* coarsest,
                                             Result<Dim>& result, const Monitor& monitor) {
  if (settings.steps.coarser) return compare_paths(settings, *settings.steps.coarser, coarsest, result, monitor);
  const Stage stage("coarser cloud", monitor);
  Result<Dim> other;
  other.mesh = result.mesh;
  other.model = result.model;
  try {
    const Settings<Dim> of_other = coarser(settings, result);
    approximate_once(of_other, other, stage.within());
    if (spacing_ratio(other, result) < least_coarsening)
      return fmt::format("a coarser cloud has {} nodes for {}", other.approximation.nodes.cols(),
                         result.approximation.nodes.cols());
    answer_by_steps<Dim>(of_other, nullptr, other, stage.within());
    return compare_paths<Dim>(settings, other, nullptr, result, stage.within());
  } catch (const InputError& error) {
    return fmt::format("no coarser cloud can be made: {}", error.what());
  } catch (const NumericalError& error) {
    return fmt::format("a coarser cloud finds no path: {}", error.what());
  }
}

template std::string estimate_path<2>(const Settings<2>&, const Result<2>*, Result<2>&, const Monitor&);
template std::string estimate_path<3>(const Settings<3>&, const Result<3>*, Result<3>&, const Monitor&);

}  // namespace efree::internal
