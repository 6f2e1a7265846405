// SPDX-License-Identifier: GPL-3.0-or-later
/// Values of load paths, and how they differ from one path to another.
#pragma once

#include "efree/analysis/result.hpp"

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

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
  Curve work, dissipated;  ///< energies: stored and dissipated, and the latter alone
  std::map<std::string, Curve> reactions, probes;
};
template <int Dim> Curves curves_of(const Settings<Dim>& settings, const Result<Dim>& result);

/// By name, what errors of values are over: the largest on their path, or a hundredth of the largest of all if that is
/// more.
std::map<std::string, double> sizes_of(const std::map<std::string, Curve>& curves);
/// What times are over where paths are compared along an arc: the largest, by size.
double period_of(const Curve& curve);

/// The times of the steps of a path.
template <int Dim> std::vector<double> times_of(const Result<Dim>& result);
/// The value at a time at which a path stops; null at others.
const Vector* value_at(const Curve& curve, double time);
/// The largest difference at times that both paths stop at; infinity without any.
double difference_in_time(const Curve& curve, const Curve& other);
/// The largest distance from the steps of a path to the other path, from rest on straight between its steps, with times
/// measured by `period` and values by `size`; steps beyond the end of the other do not count. In units of `size`.
double distance_of_curves(const Curve& curve, const Curve& other, double period, double size);
/// The root mean square of the differences of the stresses of two results over that of the stresses, at the middles of
/// up to 20000 cells; cells whose middle is outside of the other's mesh, beside its chords, do not count.
template <int Dim> double difference_of_stresses(const Result<Dim>& result, const Result<Dim>& other);

/// Settings of a path to compare one with: of the same model, without estimates, which ends where the other has.
template <int Dim> Settings<Dim> same_path(const Settings<Dim>& settings, const Result<Dim>& result);

}  // namespace efree::internal
