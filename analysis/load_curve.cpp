// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/load_curve.hpp"

#include "efree/core/error.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

namespace efree::internal {
namespace {

constexpr Index most_vertices = 50, most_intervals = 12800;
constexpr double golden = 0.6180339887498949;

template <int Dim> Points<Dim> some_vertices(const FineMesh<Dim>& mesh) {
  const Points<Dim>& vertices = mesh.vertices();
  const Index count = std::min<Index>(most_vertices, static_cast<Index>(vertices.cols()));
  Points<Dim> at(Dim, count);
  for (Index k = 0; k < count; ++k) at.col(k) = vertices.col(k * (vertices.cols() - 1) / (count - 1));
  return at;
}

/// Where the lines through two values before and two after the j-th meet, if that is within an interval of it.
std::optional<double> meeting_near(const std::vector<double>& f, int j) {
  const int last = static_cast<int>(f.size()) - 1;
  if (j < 2 || j > last - 2) return {};
  const double before = f[j - 1] - f[j - 2], after = f[j + 2] - f[j + 1];
  const double x = j + (f[j + 1] - f[j - 1] - before - after) / (before - after);
  return std::abs(x - j) <= 1.0 ? std::optional(x) : std::nullopt;
}

/// Where a value is largest (direction 1) or smallest (-1) near the j-th: where straight lines meet, or by the golden
/// section (Kiefer 1953).
template <class At> double extreme_near(const std::vector<double>& f, int j, int direction, const At& at) {
  constexpr int cuts = 12;
  const double last = static_cast<double>(f.size()) - 1.0;
  const auto height = [&](double x) { return direction * at(x); };
  double low = std::max(j - 1.0, 0.0), high = std::min(j + 1.0, last);
  double left = high - golden * (high - low), right = low + golden * (high - low);
  double of_left = height(left), of_right = height(right);
  for (int k = 0; k < cuts; ++k) {
    if (of_left < of_right) {
      low = std::exchange(left, right);
      of_left = std::exchange(of_right, height(right = low + golden * (high - low)));
    } else {
      high = std::exchange(right, left);
      of_right = std::exchange(of_left, height(left = high - golden * (high - low)));
    }
  }
  const double found = 0.5 * (low + high);
  const double best = height(found) > direction * f[j] ? found : j;
  const auto meeting = meeting_near(f, j);
  return meeting && height(*meeting) >= height(best) ? *meeting : best;
}

/// Where a value, known at whole intervals and, by `at`, everywhere, has extremes, but for ripples, and kinks
/// [intervals].
template <class At> std::vector<double> turns_of(const std::vector<double>& f, double ripple, const At& at) {
  constexpr double least_kink = 0.05;         // change of the slope, over that of the largest value in the whole time
  constexpr double kink_to_curvature = 10.0;  // change of the slope over its changes nearby; 3 where all is smooth
  std::vector<double> turns;
  const int last = static_cast<int>(f.size()) - 1;
  int extreme = 0, direction = 0;
  for (int j = 1; j <= last; ++j) {
    const double beyond = f[j] - f[extreme];
    if (direction * beyond > 0.0 || (direction == 0 && std::abs(beyond) <= ripple)) {
      if (direction != 0) extreme = j;
    } else if (std::abs(beyond) > ripple) {
      if (direction != 0) turns.push_back(extreme_near(f, extreme, direction, at));
      direction = beyond > 0.0 ? 1 : -1;
      extreme = j;
    }
  }
  for (int j = 3; j <= last - 3; ++j) {
    const auto slope = [&](int k) { return f[k] - f[k - 1]; };
    const double change = std::abs(slope(j + 2) - slope(j - 1));
    const double nearby = std::max(std::abs(slope(j - 1) - slope(j - 2)), std::abs(slope(j + 3) - slope(j + 2)));
    if (change * last < least_kink || change < kink_to_curvature * nearby) continue;
    if (const auto x = meeting_near(f, j); x && std::abs(*x - j) <= 0.5 + 1e-6) turns.push_back(*x);
  }
  return turns;
}

}  // namespace

template <int Dim>
LoadCurve<Dim>::LoadCurve(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, int least, double tolerance)
    : settings_(settings), end_(settings.time->path.end), vertices_(some_vertices(mesh)), intervals_(least) {
  Vector first;
  loads_ = loads_at(0.0, first);
  scales_.setZero(first.size());
  for (Index j = 0; j <= intervals_; ++j) {
    Vector values = sample(end_ * j / intervals_);
    if (values.size() != first.size()) break;
    samples_.push_back(std::move(values));
  }
  find_scales();
  for (const Load& load : loads_)
    moves_supports_ = moves_supports_ || (load.is_displacement && scales_[load.first] > 0.0);
  // As many bad intervals as with samples half as close are jumps: these stay.
  Index bad = count_bad_intervals(tolerance);
  is_followed_ = bad == 0;
  while (!is_followed_ && intervals_ < most_intervals) {
    double_samples();
    const Index before = std::exchange(bad, count_bad_intervals(tolerance));
    is_followed_ = bad == 0 || bad == before;
  }
}

/// What acts at a time: loads, and their values one after another. Nothing where an expression has no value, which the
/// path says if it comes there.
template <int Dim>
std::vector<typename LoadCurve<Dim>::Load> LoadCurve<Dim>::loads_at(double time, Vector& values) const {
  std::vector<Load> loads;
  std::vector<double> all;
  const auto add = [&](const std::string& name, const auto& of, bool is_displacement = false) {
    const auto first = static_cast<Index>(all.size());
    for (Index k = 0; k < vertices_.cols(); ++k) {
      const Vector value = Vector(of(Vec<Dim>(vertices_.col(k))));
      all.insert(all.end(), value.begin(), value.end());
    }
    loads.push_back({name, first, static_cast<Index>(all.size()) - first, is_displacement});
  };
  const auto number = [](const ScalarField<Dim>& field) {
    return [&field](const Vec<Dim>& x) { return Vec<1>(field(x)); };
  };
  try {
    const Acting<Dim> acting = settings_.time->acting(time);
    for (const DisplacementCondition<Dim>& support : acting.supports) {
      for (const ScalarField<Dim>& component : support.components)
        if (component) add(support.on, number(component), true);
      if (support.normal) add(support.on, number(support.normal), true);
    }
    const Vec<Dim> normal = Vec<Dim>::Ones().normalized();
    for (const auto& of : acting.loads.tractions) add(of.on, [&](const Vec<Dim>& x) { return of.traction(x, normal); });
    for (const auto& of : acting.loads.followers) add(of.on, number(of.pressure));
    for (const auto& of : acting.loads.resultants) {
      add(of.on, [&](const Vec<Dim>&) { return of.force; });
      add(of.on, [&](const Vec<Dim>&) { return of.moment; });
    }
    for (const auto& of : acting.loads.mass_forces) add("the body", of.per_mass);
    if (acting.loads.body_force) add("the body", acting.loads.body_force);
  } catch (const InputError&) {
    values.resize(0);
    return {};
  }
  values = Eigen::Map<const Vector>(all.data(), std::ssize(all));
  if (!values.allFinite()) values.resize(0);
  return loads;
}

/// The values at a time; none where these are of other loads than at the beginning.
template <int Dim> Vector LoadCurve<Dim>::sample(double time) const {
  Vector values;
  const std::vector<Load> loads = loads_at(time, values);
  const bool are_alike = std::ranges::equal(
      loads, loads_, [](const Load& a, const Load& b) { return a.on == b.on && a.first == b.first; });
  return are_alike ? values : Vector();
}

/// The values at a time, straight between samples where they are not known.
template <int Dim> Vector LoadCurve<Dim>::at(double time) const {
  Vector values = sample(time);
  if (values.size() == scales_.size()) return values;
  const auto last = static_cast<Index>(std::ssize(samples_) - 1);
  const double x = std::clamp(time / end_ * intervals_, 0.0, static_cast<double>(last));
  const Index before = std::min(static_cast<Index>(x), last), after = std::min(before + 1, last);
  return samples_[before] + (x - before) * (samples_[after] - samples_[before]);
}

template <int Dim>
Deviation LoadCurve<Dim>::deviation(const Vector& value, const Vector& from, const Vector& to) const {
  const Vector along = scales_.cwiseProduct(to - from), off = scales_.cwiseProduct(value - from);
  const double square = along.squaredNorm();
  const double share = square > 0.0 ? std::clamp(off.dot(along) / square, 0.0, 1.0) : 0.0;
  Index worst = 0;
  const double distance = off.size() > 0 ? (off - share * along).cwiseAbs().maxCoeff(&worst) : 0.0;
  const auto of = std::ranges::find_if(loads_, [&](const Load& load) { return worst < load.first + load.count; });
  return {distance, of != loads_.end() ? of->on : std::string()};
}

template <int Dim> Deviation LoadCurve<Dim>::deviation(double from, double to) const {
  const Vector first = at(from), last = at(to);
  Deviation most;
  for (auto j = static_cast<Index>(from / end_ * intervals_) + 1;
       j < std::ssize(samples_) && j * end_ < to * intervals_; ++j)
    if (Deviation here = deviation(samples_[j], first, last); here.distance > most.distance) most = std::move(here);
  return most;
}

template <int Dim> double LoadCurve<Dim>::change(double from, double to) const {
  return scales_.size() > 0 ? scales_.cwiseProduct(at(to) - at(from)).cwiseAbs().maxCoeff() : 0.0;
}

/// Intervals between whose ends the curve is not straight. It is looked at there at uneven times: even ones may all
/// meet zeros of a sine.
template <int Dim> Index LoadCurve<Dim>::count_bad_intervals(double tolerance) const {
  Index bad = 0;
  for (Index j = 0; j + 1 < std::ssize(samples_); ++j) {
    double whole = 0.0;
    const double share = 0.15 + 0.7 * std::modf((j + 1) * golden, &whole);
    const Vector there = sample(end_ * (j + share) / intervals_);
    if (there.size() == scales_.size() && deviation(there, samples_[j], samples_[j + 1]).distance > tolerance) ++bad;
  }
  return bad;
}

template <int Dim> void LoadCurve<Dim>::double_samples() {
  intervals_ *= 2;
  std::vector<Vector> samples;
  for (Index j = 0; j < std::ssize(samples_); ++j) {
    samples.push_back(std::move(samples_[j]));
    if (2 * j + 1 > intervals_) break;
    Vector between = sample(end_ * (2 * j + 1) / intervals_);
    if (between.size() != scales_.size()) break;
    samples.push_back(std::move(between));
  }
  samples_ = std::move(samples);
  find_scales();
}

template <int Dim> void LoadCurve<Dim>::find_scales() {
  for (const Load& load : loads_) {
    double largest = 0.0;
    for (const Vector& values : samples_)
      largest = std::max(largest, values.segment(load.first, load.count).cwiseAbs().maxCoeff());
    scales_.segment(load.first, load.count).setConstant(largest > 0.0 ? 1.0 / largest : 0.0);
  }
}

template <int Dim> std::vector<double> LoadCurve<Dim>::turns(double ripple) const {
  std::vector<double> all;
  std::set<std::vector<double>> seen;  // a load may be the same at all vertices
  for (Index k = 0; k < scales_.size(); ++k) {
    if (scales_[k] == 0.0) continue;
    std::vector<double> value(samples_.size());
    std::ranges::transform(samples_, value.begin(), [&](const Vector& sample) { return scales_[k] * sample[k]; });
    if (const auto& [place, is_new] = seen.insert(std::move(value)); is_new)
      for (const double x : turns_of(*place, ripple, [&](double interval) { return value_at(k, interval); }))
        all.push_back(x);
  }
  std::ranges::sort(all);
  std::vector<double> times;
  for (const double x : all) {
    const double time = end_ * x / intervals_;
    if (times.empty() || time > times.back() + 0.5 * end_ / intervals_) times.push_back(time);
  }
  return times;
}

template <int Dim> std::vector<std::pair<double, double>> LoadCurve<Dim>::jumps(double ripple) const {
  constexpr double beyond = 10.0;  // over the changes before and after
  constexpr double width = 1e-9;   // of the way
  const auto change = [&](Index j) {
    return j >= 0 && j + 1 < std::ssize(samples_)
               ? scales_.cwiseProduct(samples_[j + 1] - samples_[j]).cwiseAbs().maxCoeff()
               : 0.0;
  };
  std::vector<std::pair<double, double>> result;
  for (Index j = 0; j + 1 < std::ssize(samples_) && scales_.size() > 0; ++j) {
    const double whole = change(j);
    if (whole < ripple || whole < beyond * std::max(change(j - 1), change(j + 1))) continue;
    double from = end_ * j / intervals_, to = end_ * (j + 1) / intervals_;
    Vector before = samples_[j], after = samples_[j + 1];
    while (to - from > width * end_) {
      const double middle = 0.5 * (from + to);
      Vector there = at(middle);
      const bool is_before = scales_.cwiseProduct(there - before).norm() < scales_.cwiseProduct(there - after).norm();
      (is_before ? from : to) = middle;
      (is_before ? before : after) = std::move(there);
    }
    if (scales_.cwiseProduct(after - before).cwiseAbs().maxCoeff() > 0.5 * whole) result.emplace_back(from, to);
  }
  return result;
}

/// A value at a multiple of intervals, over the largest of its load.
template <int Dim> double LoadCurve<Dim>::value_at(Index value, double intervals) const {
  return scales_[value] * at(end_ * intervals / intervals_)[value];
}

template class LoadCurve<2>;
template class LoadCurve<3>;

}  // namespace efree::internal
