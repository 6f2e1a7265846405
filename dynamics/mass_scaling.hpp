// SPDX-License-Identifier: GPL-3.0-or-later
/// Mass scaling in quasi-static runs of explicit dynamics: masses that were added, and the error by their inertia.
#pragma once

#include "efree/core/types.hpp"

#include <tuple>
#include <vector>

namespace efree {

/// Masses of a body with mass scaling, in the plane per unit thickness, axisymmetric per full revolution [mass].
struct BodyMass {
  double real = 0.0, added = 0.0;
  Index points = 0;  ///< material points with mass that MassScaling::step added
};

/// What the added mass does at a time, by mean velocities since the last sample.
struct InertiaSample {
  double kinetic = 0.0;   ///< its kinetic energy
  double internal = 0.0;  ///< energy stored and dissipated in bodies
  double inertia = 0.0;   ///< sum of the norms of its inertial forces, times the extents of the bodies [energy]
  double stress = 0.0;    ///< sum of the norms of the stresses of the points times their volumes [energy]

  friend auto fields(InertiaSample& of) {
    auto& [kinetic, internal, inertia, stress] = of;
    return std::tie(kinetic, internal, inertia, stress);
  }
};

/// Inertia of the added mass over a run, sampled at equal numbers of steps.
class AddedInertia {
 public:
  /// The samples that are kept for ratios are at most some thousand, evenly spread.
  void add(const InertiaSample& sample);
  bool empty() const { return samples_.empty(); }
  const std::vector<InertiaSample>& samples() const { return samples_; }
  /// Estimated error of forces, over the largest: the largest `inertia` over the largest `stress`. Infinity where
  /// bodies bear no stress. In a bar of stiffness K, mass M and length L that is met at the speed v it is exact: the
  /// wave of the impact has the force v sqrt(K M), and stops, or moves, the mass M by v in the time L / c = sqrt(M /
  /// K).
  double error() const;
  /// Largest and median ratio of kinetic to internal energy, of the samples in which the latter is at least a tenth of
  /// its largest. In quasi-static processes it is 5 to 10 % at most, as a rule (Prior 1994).
  double largest_ratio() const { return ratio(1.0); }
  double median_ratio() const { return ratio(0.5); }

  friend auto fields(AddedInertia& of) {
    auto& [samples, interval, count, inertia, stress] = of;
    return std::tie(samples, interval, count, inertia, stress);
  }

 private:
  double ratio(double share) const;

  std::vector<InertiaSample> samples_;
  Index interval_ = 1, count_ = 0;       ///< calls of `add` from one sample to the next, and so far
  double inertia_ = 0.0, stress_ = 0.0;  ///< largest
};

}  // namespace efree
