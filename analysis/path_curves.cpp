// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/path_curves.hpp"

#include "efree/assembly/follower_pressure.hpp"
#include "efree/core/error.hpp"

#include <cmath>
#include <limits>

namespace efree::internal {

template <int Dim> Curves curves_of(const Settings<Dim>& settings, const Result<Dim>& result) {
  Curves curves;
  const auto& vertices = result.mesh->vertices();
  const double length = (vertices.rowwise().maxCoeff() - vertices.rowwise().minCoeff()).norm();
  for (const HistoryStep<Dim>& step : result.history) {
    curves.work.add(step.time, Vector::Constant(1, step.stored + step.dissipated));
    curves.dissipated.add(step.time, Vector::Constant(1, step.dissipated));
    for (const auto& [name, of] : step.reactions)
      curves.reactions[name].add(step.time, of.force, of.moment.norm() / length);  // a moment may be all there is
    for (std::size_t k = 0; k < step.probes.size(); ++k)
      curves.probes[settings.probes[k].name].add(step.time, step.probes[k]);
  }
  return curves;
}

std::map<std::string, double> sizes_of(const std::map<std::string, Curve>& curves) {
  constexpr double small = 0.01;
  double most = 0.0;
  for (const auto& [name, curve] : curves) most = std::max(most, curve.largest);
  std::map<std::string, double> sizes;
  for (const auto& [name, curve] : curves) sizes[name] = std::max(curve.largest, small * most);
  return sizes;
}

double period_of(const Curve& curve) {
  double period = 0.0;
  for (const double time : curve.times) period = std::max(period, std::abs(time));
  return period;
}

template <int Dim> std::vector<double> times_of(const Result<Dim>& result) {
  std::vector<double> times;
  for (const auto& step : result.history) times.push_back(step.time);
  return times;
}

const Vector* value_at(const Curve& curve, double time) {
  const auto found = std::ranges::lower_bound(curve.times, time);
  return found != curve.times.end() && *found == time ? &curve.values[found - curve.times.begin()] : nullptr;
}

double difference_in_time(const Curve& curve, const Curve& other) {
  double off = -1.0;
  for (std::size_t k = 0; k < curve.times.size(); ++k)
    if (const Vector* value = value_at(other, curve.times[k])) off = std::max(off, (curve.values[k] - *value).norm());
  return off < 0.0 ? std::numeric_limits<double>::infinity() : off;
}

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

template <int Dim> Settings<Dim> same_path(const Settings<Dim>& settings, const Result<Dim>& result) {
  Settings<Dim> other = settings;
  other.estimated = other.corrected = false;
  other.regime = result.regime;
  other.common.model = result.model;
  other.steps = {};
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
  const bool by_load = other.time->path.control == Control::load;
  if (other.time->until && by_load && result.stopped.empty()) {  // it ends at the same time
    other.time->until.reset();
    other.time->path.until = [last = result.history.back().time](const PathStep& step) {
      return step.now.state.time >= last;
    };
  }
  if (!by_load)  // it may never come to its end
    other.time->path.max_steps = std::min(other.time->path.max_steps, 2 * static_cast<int>(result.history.size()));
  return other;
}

#define EFREE_INSTANTIATE(Dim)                                                    \
  template Curves curves_of(const Settings<Dim>&, const Result<Dim>&);            \
  template std::vector<double> times_of(const Result<Dim>&);                      \
  template double difference_of_stresses(const Result<Dim>&, const Result<Dim>&); \
  template Settings<Dim> same_path(const Settings<Dim>&, const Result<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
