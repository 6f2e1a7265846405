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
/// With what power of the spacing errors fall: between what linear functions do around corners and where all is smooth;
/// of quadratic elements between fronts of flow and chords of curved boundaries, and where all is smooth.
constexpr double order_of(BasisKind kind) {
  return kind == BasisKind::p2 ? 2.0 : 1.5;
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

/// The largest difference at times that both paths stop at; infinity without any.
double difference_in_time(const Curve& curve, const Curve& other) {
  double off = -1.0;
  std::size_t there = 0;
  for (std::size_t k = 0; k < curve.times.size(); ++k) {
    while (there < other.times.size() && other.times[there] < curve.times[k]) ++there;
    if (there < other.times.size() && other.times[there] == curve.times[k])
      off = std::max(off, (curve.values[k] - other.values[there]).norm());
  }
  return off < 0.0 ? std::numeric_limits<double>::infinity() : off;
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

/// Relative differences of values by name, over the largest of each or a hundredth of the largest of all.
template <class Compare> std::map<std::string, double> differences(const std::map<std::string, Curve>& curves,
                                                                   const std::map<std::string, Curve>& others,
                                                                   const Compare& compare) {
  constexpr double small = 0.01;
  double most = 0.0;
  for (const auto& [name, curve] : curves) most = std::max(most, curve.largest);
  std::map<std::string, double> errors;
  for (const auto& [name, curve] : curves)
    errors[name] = compare(curve, others.at(name), std::max(curve.largest, small * most));
  return errors;
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

template <int Dim>
std::string compare_paths(const Settings<Dim>& settings, const Result<Dim>& other, Result<Dim>& result) {
  PathErrors errors;
  errors.coarser = spacing_ratio(other, result);
  if (errors.coarser < least_coarsening)
    return fmt::format("a coarser path has {} nodes for {}", other.approximation.nodes.cols(),
                       result.approximation.nodes.cols());
  const double factor = 1.0 / (std::pow(errors.coarser, order_of(settings.approximation.kind)) - 1.0);
  const bool by_arc = settings.time && settings.time->path.control == Control::arc_length;
  const Curves curves = curves_of(settings, result), others = curves_of(settings, other);
  const double end = result.history.back().time, end_of_other = other.history.back().time;
  if (by_arc) {
    errors.until = std::min(end, end_of_other);
  } else {
    for (const double time : curves.work.times)
      if (std::ranges::binary_search(others.work.times, time)) errors.until = time;
    if (errors.until == 0.0)
      return fmt::format("a coarser path did not reach time {:.6g}", result.history.front().time);
  }
  double period = 0.0;
  for (const double time : curves.work.times) period = std::max(period, std::abs(time));
  const auto compare = [&](const Curve& curve, const Curve& of_other, double size) {
    if (size == 0.0) return 0.0;
    return factor *
           (by_arc ? distance_of_curves(curve, of_other, period, size) : difference_in_time(curve, of_other) / size);
  };
  errors.work = compare(curves.work, others.work, curves.work.largest);
  errors.reactions = differences(curves.reactions, others.reactions, compare);
  errors.probes = differences(curves.probes, others.probes, compare);
  if (!by_arc && !result.stopped.empty() && !other.stopped.empty())
    errors.limit = factor * std::abs(end - end_of_other) / std::abs(end);
  if (end == end_of_other) errors.stress = factor * difference_of_stresses(result, other);
  result.path_errors = std::move(errors);
  return {};
}

template <int Dim>
std::string estimate_path(const Settings<Dim>& settings, Result<Dim>& result, const Monitor& monitor) {
  if (settings.steps.coarser) return compare_paths(settings, *settings.steps.coarser, result);
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
    answer_by_steps(of_other, other, stage.within());
    return compare_paths(settings, other, result);
  } catch (const InputError& error) {
    return fmt::format("no coarser cloud can be made: {}", error.what());
  } catch (const NumericalError& error) {
    return fmt::format("a coarser cloud finds no path: {}", error.what());
  }
}

template std::vector<double> times_of<2>(const Result<2>&);
template std::string compare_paths<2>(const Settings<2>&, const Result<2>&, Result<2>&);
template std::string estimate_path<2>(const Settings<2>&, Result<2>&, const Monitor&);
template std::vector<double> times_of<3>(const Result<3>&);
template std::string compare_paths<3>(const Settings<3>&, const Result<3>&, Result<3>&);
template std::string estimate_path<3>(const Settings<3>&, Result<3>&, const Monitor&);

}  // namespace efree::internal
