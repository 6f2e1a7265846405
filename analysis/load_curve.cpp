// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/load_curve.hpp"

#include "efree/core/error.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

namespace efree::internal {
namespace {

constexpr Index most_intervals = 12800;
/// Places of a part at which a load is looked at for where it changes, those of these at which it is sampled, and those
/// of these whose turns count.
constexpr Index most_places = 2000, most_samples = 50, most_turning = 5;
constexpr double golden = 0.6180339887498949;

/// The k-th of numbers that are spread over [0, 1) unevenly: even ones may all meet zeros of a sine.
double uneven(Index k) {
  double whole = 0.0;
  return std::modf(static_cast<double>(k + 1) * golden, &whole);
}

/// Some of n, evenly, no more than `most`.
std::vector<Index> some_of(Index n, Index most) {
  std::vector<Index> result;
  const Index count = std::min(n, most);
  for (Index k = 0; k < count; ++k) result.push_back(count > 1 ? k * (n - 1) / (count - 1) : 0);
  return result;
}

/// Middles of facets of a part, or of cells: where loads and displacements are asked for.
template <int Dim> Points<Dim> places_in(const FineMesh<Dim>& mesh, const std::string& part) {
  if (part.empty()) {
    const std::vector<Index> cells = some_of(mesh.num_cells(), most_places);
    Points<Dim> result(Dim, std::ssize(cells));
    for (std::size_t k = 0; k < cells.size(); ++k) result.col(k) = mesh.centroid(cells[k]);
    return result;
  }
  const std::vector<Index>& facets = mesh.group(part);
  const std::vector<Index> some = some_of(std::ssize(facets), most_places);
  Points<Dim> result(Dim, std::ssize(some));
  for (std::size_t k = 0; k < some.size(); ++k)
    result.col(k) = mesh.vertices()(Eigen::all, mesh.facets().col(facets[some[k]])).rowwise().mean();
  return result;
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
    : settings_(settings), mesh_(mesh), end_(settings.time->path.end), intervals_(least) {
  find_places();
  for (Index j = 0; j <= intervals_; ++j) {
    Vector values = sample_near(end_ * j / intervals_);
    if (j > 0 && values.size() != samples_.front().size()) break;
    samples_.push_back(std::move(values));
  }
  scales_.setZero(samples_.front().size());
  find_scales();
  constexpr Index first_checks = 4;
  is_followed_ = !loads_.empty() && count_bad_intervals(tolerance, first_checks) == 0;
  while (!is_followed_ && intervals_ < most_intervals && scales_.size() > 0) {
    double_samples();
    is_followed_ = count_bad_intervals(tolerance, 1) == 0;
  }
}

/// Where each load is sampled: places of its part at which it changes; one, if it is the same at all.
template <int Dim> void LoadCurve<Dim>::find_places() {
  constexpr Index times = 21;
  constexpr double changes = 0.01;  // over the largest change
  std::vector<Vector> all;
  for (Index k = 0; k < times; ++k) {
    Vector values;
    std::vector<Load> loads = loads_at(end_ * uneven(k), values);
    if (values.size() == 0 || (!all.empty() && all.front().size() != values.size())) continue;
    if (all.empty()) loads_ = std::move(loads);
    all.push_back(std::move(values));
  }
  std::vector<Points<Dim>> places;
  Index first = 0;
  for (Load& load : loads_) {
    const Points<Dim> there = places_in(mesh_, load.part);
    const Index size = load.count / static_cast<Index>(there.cols());
    Vector low = all.front().segment(load.first, load.count), high = low;
    bool is_same = true;
    for (const Vector& values : all) {
      const auto now = values.segment(load.first, load.count);
      low = low.cwiseMin(now);
      high = high.cwiseMax(now);
      const auto by_place = now.reshaped(size, there.cols());
      is_same = is_same && (by_place.colwise() - by_place.col(0)).isZero(1e-12 * now.cwiseAbs().maxCoeff());
    }
    const Vector change = (high - low).reshaped(size, there.cols()).colwise().maxCoeff();
    std::vector<Index> changing;
    for (Index k = 0; k < change.size() && !is_same; ++k)
      if (change[k] > changes * change.maxCoeff()) changing.push_back(k);
    if (changing.empty()) changing = {0};
    std::vector<Index> chosen;
    for (const Index k : some_of(std::ssize(changing), most_samples)) chosen.push_back(changing[k]);
    places.push_back(there(Eigen::all, chosen));
    load.size = size;
    load.first = first;
    load.count = size * static_cast<Index>(chosen.size());
    first += load.count;
  }
  places_ = std::move(places);
}

/// What acts at a time: loads, and their values one after another. Nothing where an expression has no value, which the
/// path says if it comes there.
template <int Dim>
std::vector<typename LoadCurve<Dim>::Load> LoadCurve<Dim>::loads_at(double time, Vector& values) const {
  std::vector<Load> loads;
  std::vector<double> all;
  const auto add = [&](Kind kind, const std::string& part, const auto& of) {
    const bool is_found = loads.size() < places_.size();
    const Points<Dim> all_there = is_found ? Points<Dim>() : places_in(mesh_, part);
    const Points<Dim>& there = is_found ? places_[loads.size()] : all_there;
    const auto first = static_cast<Index>(all.size());
    for (Index k = 0; k < there.cols(); ++k) {
      const Vector value = Vector(of(Vec<Dim>(there.col(k))));
      all.insert(all.end(), value.begin(), value.end());
    }
    loads.push_back({.kind = kind, .part = part, .first = first, .count = static_cast<Index>(all.size()) - first});
  };
  const auto number = [](const ScalarField<Dim>& field) {
    return [&field](const Vec<Dim>& x) { return Vec<1>(field(x)); };
  };
  try {
    const Acting<Dim> acting = settings_.time->acting(time);
    for (const DisplacementCondition<Dim>& support : acting.supports) {
      for (const ScalarField<Dim>& component : support.components)
        if (component) add(Kind::displacement, support.on, number(component));
      if (support.normal) add(Kind::displacement, support.on, number(support.normal));
    }
    const Vec<Dim> normal = Vec<Dim>::Ones().normalized();
    for (const auto& of : acting.loads.tractions)
      add(Kind::traction, of.on, [&](const Vec<Dim>& x) { return of.traction(x, normal); });
    for (const auto& of : acting.loads.followers) add(Kind::traction, of.on, number(of.pressure));
    for (const auto& of : acting.loads.resultants) {
      add(Kind::force, of.on, [&](const Vec<Dim>&) { return of.force; });
      add(Kind::moment, of.on, [&](const Vec<Dim>&) { return of.moment; });
    }
    for (const auto& of : acting.loads.mass_forces) add(Kind::per_mass, "", of.per_mass);
    if (acting.loads.body_force) add(Kind::per_volume, "", acting.loads.body_force);
  } catch (const InputError&) {
    values.resize(0);
    return {};
  }
  values = Eigen::Map<const Vector>(all.data(), std::ssize(all));
  if (!values.allFinite()) values.resize(0);
  return loads;
}

/// The values at a time; none where these are of other loads than at first.
template <int Dim> Vector LoadCurve<Dim>::sample(double time) const {
  Vector values;
  const std::vector<Load> loads = loads_at(time, values);
  const bool are_alike = std::ranges::equal(
      loads, loads_, [](const Load& a, const Load& b) { return a.kind == b.kind && a.part == b.part; });
  return are_alike ? values : Vector();
}

/// Likewise, or a little later or earlier: a single time may have none, as 0 of 1/t.
template <int Dim> Vector LoadCurve<Dim>::sample_near(double time) const {
  constexpr double little = 1e-3;  // intervals
  Vector values = sample(time);
  for (const double sign : {1.0, -1.0})
    if (values.size() == 0) values = sample(time + sign * little * end_ / intervals_);
  return values;
}

template <int Dim> bool LoadCurve<Dim>::moves_supports() const {
  return std::ranges::any_of(
      loads_, [&](const Load& load) { return load.kind == Kind::displacement && scales_[load.first] > 0.0; });
}

template <int Dim> double LoadCurve<Dim>::known_until() const {
  return scales_.size() > 0 ? end_ * (std::ssize(samples_) - 1) / intervals_ : 0.0;
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
  return {.distance = distance,
          .change = along.size() > 0 ? along.cwiseAbs().maxCoeff() : 0.0,
          .on = of == loads_.end() || of->part.empty() ? "the body" : of->part};
}

template <int Dim> Deviation LoadCurve<Dim>::deviation(double from, double to) const {
  const Vector first = at(from), last = at(to);
  Deviation most = deviation(first, first, last);
  for (auto j = static_cast<Index>(from / end_ * intervals_) + 1;
       j < std::ssize(samples_) && j * end_ < to * intervals_; ++j)
    if (Deviation here = deviation(samples_[j], first, last); here.distance > most.distance) most = std::move(here);
  return most;
}

/// Where the curve has corners between samples [intervals], ascending: jumps, and turns that are well apart.
template <int Dim> std::vector<double> LoadCurve<Dim>::find_corners(double ripple) const {
  constexpr double apart = 8.0;
  std::vector<double> corners;
  for (const TurningValue& value : turning_values()) {
    const std::vector<double>& samples = value.samples;
    std::vector<double> turns =
        turns_of(samples, ripple, [&](double x) { return samples[static_cast<std::size_t>(std::lround(x))]; });
    std::ranges::sort(turns);
    const auto same = [](double one, double other) { return other - one < 1.0; };  // an extreme is a kink, too
    turns.erase(std::unique(turns.begin(), turns.end(), same), turns.end());
    for (std::size_t k = 0; k < turns.size(); ++k) {
      if ((k > 0 && turns[k] <= turns[k - 1] + apart) || (k + 1 < turns.size() && turns[k] >= turns[k + 1] - apart))
        continue;
      const int j = static_cast<int>(std::lround(turns[k])), before = std::max(j - 1, 0);
      corners.push_back(turns[k]);
      corners.push_back(extreme_near(samples, j, samples[j] >= samples[before] ? 1 : -1,
                                     [&](double interval) { return value_at(value.number, interval); }));
    }
  }
  for (const auto& [before, after] : jumps(ripple))
    corners.insert(corners.end(), {before / end_ * intervals_, after / end_ * intervals_});
  std::ranges::sort(corners);
  return corners;
}

/// Intervals in which the curve is not straight from the beginning to a corner, from corner to corner, or on to the
/// end, as far as that is looked at.
template <int Dim> Index LoadCurve<Dim>::count_bad_intervals(double tolerance, Index checks) const {
  const std::vector<double> corners = find_corners(tolerance);
  Index bad = 0;
  for (Index j = 0; j + 1 < std::ssize(samples_); ++j) {
    bool is_straight = true;
    for (Index c = 0; c < checks && is_straight; ++c) {
      const double share = (static_cast<double>(c) + 0.15 + 0.7 * uneven(j * checks + c)) / checks;
      const Vector there = sample(end_ * (j + share) / intervals_);
      if (there.size() != scales_.size()) continue;
      is_straight = deviation(there, samples_[j], samples_[j + 1]).distance <= tolerance;
      if (is_straight) continue;
      Vector before = samples_[j];
      for (auto corner = std::ranges::upper_bound(corners, j); !is_straight; ++corner) {
        const bool is_last = corner == corners.end() || *corner >= j + 1;
        Vector after = is_last ? samples_[j + 1] : at(end_ * *corner / intervals_);
        is_straight = deviation(there, before, after).distance <= tolerance;
        before = std::move(after);
        if (is_last) break;
      }
    }
    if (!is_straight) ++bad;
  }
  return bad;
}

template <int Dim> void LoadCurve<Dim>::double_samples() {
  intervals_ *= 2;
  std::vector<Vector> samples;
  for (Index j = 0; j < std::ssize(samples_); ++j) {
    samples.push_back(std::move(samples_[j]));
    if (2 * j + 1 > intervals_) break;
    Vector between = sample_near(end_ * (2 * j + 1) / intervals_);
    if (between.size() != scales_.size()) break;
    samples.push_back(std::move(between));
  }
  samples_ = std::move(samples);
  find_scales();
}

/// Of all loads of a kind by the largest: what is small beside others of its kind is nothing.
template <int Dim> void LoadCurve<Dim>::find_scales() {
  std::map<Kind, double> largest;
  for (const Load& load : loads_)
    for (const Vector& values : samples_)
      largest[load.kind] = std::max(largest[load.kind], values.segment(load.first, load.count).cwiseAbs().maxCoeff());
  for (const Load& load : loads_)
    scales_.segment(load.first, load.count).setConstant(largest[load.kind] > 0.0 ? 1.0 / largest[load.kind] : 0.0);
}

/// Values whose turns count, by sample and over the largest: those of few places of a load, as each may turn at a time
/// of its own.
template <int Dim> std::vector<typename LoadCurve<Dim>::TurningValue> LoadCurve<Dim>::turning_values() const {
  std::vector<TurningValue> result;
  for (const Load& load : loads_)
    for (const Index place : some_of(load.count / load.size, most_turning))
      for (Index k = load.first + load.size * place; k < load.first + load.size * (place + 1); ++k) {
        if (scales_[k] == 0.0) continue;
        std::vector<double>& samples = result.emplace_back(TurningValue{k, {}}).samples;
        for (const Vector& sample : samples_) samples.push_back(scales_[k] * sample[k]);
      }
  return result;
}

template <int Dim> std::vector<double> LoadCurve<Dim>::turns(double ripple) const {
  std::vector<double> all;
  for (const auto& [value, samples] : turning_values())
    for (const double x :
         turns_of(samples, ripple, [&, of = value](double interval) { return value_at(of, interval); }))
      all.push_back(x);
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

/// A value at a multiple of intervals, over the largest of its kind.
template <int Dim> double LoadCurve<Dim>::value_at(Index value, double intervals) const {
  return scales_[value] * at(end_ * intervals / intervals_)[value];
}

template class LoadCurve<2>;
template class LoadCurve<3>;

}  // namespace efree::internal
