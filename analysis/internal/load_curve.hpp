// SPDX-License-Identifier: GPL-3.0-or-later
/// What acts on a body by time, as one curve.
#pragma once

#include "efree/analysis/prepare.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// How far a curve is from a straight line, in units of what loads are over.
struct Deviation {
  double distance = 0.0;  ///< of a value, the largest
  double change = 0.0;    ///< of a value along the line, the largest
  std::string on;         ///< the part on which the load acts whose distance it is
};

/// The curve whose coordinates are the values of all loads and prescribed displacements at places of their parts, each
/// over the largest value of its kind on the way. It is sampled at even times, ever closer until the straight lines
/// between them leave it by no more than a tolerance, but beside turns and jumps. It ends early where an expression has
/// no value, or where loads come or go.
template <int Dim> class LoadCurve {
 public:
  /// settings: of a path whose loads change with time; `least`: samples.
  LoadCurve(const Settings<Dim>& settings, const FineMesh<Dim>& mesh, int least, double tolerance);

  /// Whether the tolerance was reached.
  bool is_followed() const { return is_followed_; }
  /// Where it ends [time].
  double known_until() const;
  /// Whether displacements other than zero are prescribed.
  bool moves_supports() const;
  /// The largest distance of values between two times from the straight line between the values at these. How fast it
  /// is followed does not matter.
  Deviation deviation(double from, double to) const;
  /// Times of extremes, but for swings smaller than `ripple`, and of kinks, ascending.
  std::vector<double> turns(double ripple) const;
  /// Times before and after jumps larger than that, a billionth of the way apart.
  std::vector<std::pair<double, double>> jumps(double ripple) const;

 private:
  enum class Kind { displacement, traction, force, moment, per_mass, per_volume };
  struct Load {
    Kind kind;
    std::string part{};  ///< empty: the body
    Index first, count;  ///< of its values in a sample
    Index size = 0;      ///< values at a place
  };
  struct TurningValue {
    Index number;  ///< in a sample
    std::vector<double> samples;
  };
  void find_places();
  std::vector<Load> loads_at(double time, Vector& values) const;
  Vector sample(double time) const;
  Vector sample_near(double time) const;
  Vector at(double time) const;
  double value_at(Index value, double intervals) const;
  Deviation deviation(const Vector& value, const Vector& from, const Vector& to) const;
  std::vector<double> find_corners(double ripple) const;
  Index count_bad_intervals(double tolerance, Index checks) const;
  std::vector<TurningValue> turning_values() const;
  void double_samples();
  void find_scales();

  const Settings<Dim>& settings_;
  const FineMesh<Dim>& mesh_;
  double end_;
  std::vector<Load> loads_;
  std::vector<Points<Dim>> places_;  ///< by load
  Vector scales_;                    ///< by value, one over the largest of its kind; 0 if that is zero
  std::vector<Vector> samples_;      ///< at even times from 0 on
  Index intervals_;                  ///< of these up to the end, were the curve not to end before
  bool is_followed_ = false;
};

}  // namespace efree::internal
