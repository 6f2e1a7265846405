// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors of load paths, by comparison with a coarser path.
#include "efree/analysis/internal/paths.hpp"
#include "efree/analysis/internal/steps_estimate.hpp"
#include "efree/assembly/follower_pressure.hpp"
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
  Settings<Dim> other = settings;
  other.estimated = other.corrected = false;
  other.regime = result.regime;
  other.common.model = result.model;
  other.steps = {};
  other.common.approximation.interpolation = result.approximation.space.degree();
  other.common.approximation.grading.scale *= coarsening;
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
  other.time->path.stops = times_of(result);
  const bool by_load = other.time->path.control == Control::load;
  if (other.time->until && by_load && result.stopped.empty()) {  // it ends at the same time
    other.time->until.reset();
    other.time->path.until = [last = other.time->path.stops.back()](const PathStep& step) {
      return step.now.state.time >= last;
    };
  }
  if (!by_load)  // it may never come to its end
    other.time->path.max_steps = std::min(other.time->path.max_steps, 2 * static_cast<int>(result.history.size()));
  return other;
}

/// Values of a path by time, as vectors.
struct Curve {
  std::vector<double> times;
  std::vector<Vector> values;
  double largest = 0.0;  ///< size of the values
  void add(double time, Vector value, double size = 0.0) {
    largest = std::max({largest, value.norm(), size});
    times.push_back(time);
    values.push_back(std::move(value));
  }
};

/// All values of a path.
struct Curves {
  Curve work;
  std::map<std::string, Curve> reactions, probes;
};
template <int Dim> Curves curves_of(const Settings<Dim>& settings, const Result<Dim>& result) {
  Curves curves;
  const auto& vertices = result.mesh->vertices();
  const double length = (vertices.rowwise().maxCoeff() - vertices.rowwise().minCoeff()).norm();
  for (const HistoryStep<Dim>& step : result.history) {
    curves.work.add(step.time, Vector::Constant(1, step.stored + step.dissipated));
    for (const auto& [name, of] : step.reactions)
      curves.reactions[name].add(step.time, of.force, of.moment.norm() / length);  // a moment may be all there is
    for (std::size_t k = 0; k < step.probes.size(); ++k)
      curves.probes[settings.probes[k].name].add(step.time, step.probes[k]);
  }
  return curves;
}

/// The value at a time at which a path stops; null at others.
const Vector* value_at(const Curve& curve, double time) {
  const auto found = std::ranges::lower_bound(curve.times, time);
  return found != curve.times.end() && *found == time ? &curve.values[found - curve.times.begin()] : nullptr;
}

/// The largest difference at times that both paths stop at; infinity without any.
double difference_in_time(const Curve& curve, const Curve& other) {
  double off = -1.0;
  for (std::size_t k = 0; k < curve.times.size(); ++k)
    if (const Vector* value = value_at(other, curve.times[k])) off = std::max(off, (curve.values[k] - *value).norm());
  return off < 0.0 ? std::numeric_limits<double>::infinity() : off;
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

/// The largest distance from the steps of a path to the other path, from rest on straight between its steps, with times
/// measured by `period` and values by `size`; steps beyond the end of the other do not count. In units of `size`.
double distance_of_curves(const Curve& curve, const Curve& other, double period, double size) {
  const auto point = [&](double time, const Vector& value) {
    Vector at(value.size() + 1);
    at << time / period, value / size;
    return at;
  };
  std::vector<Vector> line{Vector::Zero(curve.values.front().size() + 1)};
  for (std::size_t k = 0; k < other.times.size(); ++k) line.push_back(point(other.times[k], other.values[k]));
  double most = 0.0;
  for (std::size_t k = 0; k < curve.times.size(); ++k) {
    const Vector at = point(curve.times[k], curve.values[k]);
    double nearest = std::numeric_limits<double>::infinity();
    bool is_end = false;
    for (std::size_t s = 0; s + 1 < line.size(); ++s) {
      const Vector along = line[s + 1] - line[s];
      const double share =
          along.squaredNorm() > 0.0 ? std::clamp((at - line[s]).dot(along) / along.squaredNorm(), 0.0, 1.0) : 0.0;
      const double distance = (at - line[s] - share * along).norm();
      if (distance >= nearest) continue;
      nearest = distance;
      is_end = s + 2 == line.size() && share == 1.0;
    }
    if (!is_end || k == 0) most = std::max(most, nearest);
  }
  return most;
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

/// The root mean square of the differences of the stresses of two results over that of the stresses, at the middles of
/// up to 20000 cells; cells whose middle is outside of the other's mesh, beside its chords, do not count.
template <int Dim> double difference_of_stresses(const Result<Dim>& result, const Result<Dim>& other) {
  constexpr Index most = 20000;
  const FineSpace<Dim>& space = result.approximation.space;
  const FineMesh<Dim>& mesh = *result.mesh;
  const bool same = result.mesh == other.mesh;
  const Index stride = 1 + mesh.num_cells() / most;
  const Locator<Dim> locate_in_other(*other.mesh);
  const auto squared = [](const Voigt<Dim>& s) {  // of the tensor: shears count twice
    return s.squaredNorm() + s.tail(s.size() - 3).squaredNorm();
  };
  double off = 0.0, size = 0.0;
  for (Index c = 0; c < mesh.num_cells(); c += stride) {
    Location<Dim> there{c, Eigen::Matrix<double, Dim + 1, 1>::Constant(1.0 / (Dim + 1))};
    const Voigt<Dim> stress = probe(space, result.fields, there).stress;
    if (!same) {
      try {
        there = locate_in_other(mesh.centroid(c));
      } catch (const InputError&) {
        continue;
      }
    }
    const Voigt<Dim> stress_of_other = probe(other.approximation.space, other.fields, there).stress;
    off += space.volume(c) * squared(stress - stress_of_other);
    size += space.volume(c) * squared(stress);
  }
  return size > 0.0 ? std::sqrt(off / size) : 0.0;
}

}  // namespace

template <int Dim> std::vector<double> times_of(const Result<Dim>& result) {
  std::vector<double> times;
  for (const auto& step : result.history) times.push_back(step.time);
  return times;
}

namespace {

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
    for (const double time : curves_.work.times) period_ = std::max(period_, std::abs(time));
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

  /// Errors over the largest of each value, or over a hundredth of the largest of all.
  std::map<std::string, double> errors_by_name(std::map<std::string, Curve> Curves::*kind) const {
    constexpr double small = 0.01;
    double most = 0.0;
    for (const auto& [name, curve] : curves_.*kind) most = std::max(most, curve.largest);
    std::map<std::string, double> errors;
    for (const auto& [name, curve] : curves_.*kind)
      errors[name] = error(curve, (of_coarser_.*kind).at(name), coarsest_ ? &(of_coarsest_.*kind).at(name) : nullptr,
                           std::max(curve.largest, small * most));
    return errors;
  }

  bool by_arc_;
  const Result<Dim>&result_, &coarser_;
  const Result<Dim>* coarsest_ = nullptr;
  double ratio_, ratio_before_ = 0.0;
  Curves curves_, of_coarser_, of_coarsest_;
  double period_ = 0.0, until_ = 0.0;
};

}  // namespace

template <int Dim> std::string compare_paths(const Settings<Dim>& settings, const Result<Dim>& coarser,
                                             const Result<Dim>* coarsest, Result<Dim>& result) {
  const Comparison<Dim> comparison(settings, result, coarser, coarsest);
  if (comparison.ratio() < least_coarsening)
    return fmt::format("a coarser path has {} nodes for {}", coarser.approximation.nodes.cols(),
                       result.approximation.nodes.cols());
  if (comparison.until() == 0.0)
    return fmt::format("a coarser path did not reach time {:.6g}", result.history.front().time);
  result.path_errors = comparison.errors();
  return {};
}

template <int Dim> std::string estimate_path(const Settings<Dim>& settings, const Result<Dim>* coarsest,
                                             Result<Dim>& result, const Monitor& monitor) {
  if (settings.steps.coarser) return compare_paths(settings, *settings.steps.coarser, coarsest, result);
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
    return compare_paths<Dim>(settings, other, nullptr, result);
  } catch (const InputError& error) {
    return fmt::format("no coarser cloud can be made: {}", error.what());
  } catch (const NumericalError& error) {
    return fmt::format("a coarser cloud finds no path: {}", error.what());
  }
}

template std::vector<double> times_of<2>(const Result<2>&);
template std::string compare_paths<2>(const Settings<2>&, const Result<2>&, const Result<2>*, Result<2>&);
template std::string estimate_path<2>(const Settings<2>&, const Result<2>*, Result<2>&, const Monitor&);
template std::vector<double> times_of<3>(const Result<3>&);
template std::string compare_paths<3>(const Settings<3>&, const Result<3>&, const Result<3>*, Result<3>&);
template std::string estimate_path<3>(const Settings<3>&, const Result<3>*, Result<3>&, const Monitor&);

}  // namespace efree::internal
