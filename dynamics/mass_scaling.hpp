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

/// Forces of the added mass at a time, by mean velocities since the last sample: inertial ones, and those of
/// DynamicsOptions::damping.
struct InertiaSample {
  double kinetic = 0.0;   ///< kinetic energy of the added mass
  double internal = 0.0;  ///< energy stored and dissipated in bodies
  double stored = 0.0;    ///< the stored part of it
  double inertia = 0.0;   ///< sum of the norms of the forces of the added mass, times the extents of bodies [energy]
  double stress = 0.0;    ///< sum of the norms of the stresses of the points times their volumes [energy]
  double force = 0.0;     ///< sum of the squared forces of the added mass over the added mass [force^2/mass]
  /// Sum of the added mass times the squared displacement since the start, without the mean of the body
  /// [mass length^2].
  double displacement = 0.0;

  friend auto fields(InertiaSample& of) {
    auto& [kinetic, internal, stored, inertia, stress, force, displacement] = of;
    return std::tie(kinetic, internal, stored, inertia, stress, force, displacement);
  }
};

/// Inertia of the added mass over a run, sampled at equal numbers of steps.
class AddedInertia {
 public:
  /// The samples that are kept for ratios are at most some thousand, evenly spread.
  void add(const InertiaSample& sample);
  /// Whether there are as many samples as an estimate needs: three.
  bool is_known() const { return samples_.size() >= 3; }
  const std::vector<InertiaSample>& samples() const { return samples_; }
  /// Estimated error of forces, over the largest: the larger of two ratios. Infinity where bodies bear no stress.
  ///
  /// The largest `inertia` over the largest `stress`. In a bar of stiffness K, mass M and length L under impact at the
  /// speed v it is exact: the wave of the impact has the force v sqrt(K M), and stops, or moves, the mass M by v in the
  /// time L / c = sqrt(M / K).
  ///
  /// The virtual work of the forces of the added mass on the displacement, at most sqrt(force displacement)
  /// (Cauchy-Schwarz), over that of the stresses, internal + stored: F u of a body of stiffness K and of a perfectly
  /// plastic one. Bending has large stresses by small forces, so that the first ratio is too small there. With
  /// Rayleigh's quotient w^2 = (internal + stored) / displacement, the frequency of the slowest mode with the scaled
  /// mass, a displacement cos(q t) has the ratio 2 (q / w)^2, twice its error.
  double error() const;
  /// Largest and median ratio of kinetic to internal energy, of the samples in which the latter is at least a tenth of
  /// its largest. In quasi-static processes it is 5 to 10 % at most, as a rule (Prior 1994).
  double largest_ratio() const { return ratio(1.0); }
  double median_ratio() const { return ratio(0.5); }

  friend auto fields(AddedInertia& of) {
    auto& [samples, interval, count, largest, work] = of;
    return std::tie(samples, interval, count, largest, work);
  }

 private:
  double ratio(double share) const;

  std::vector<InertiaSample> samples_;
  Index interval_ = 1, count_ = 0;  ///< calls of `add` from one sample to the next, and so far
  InertiaSample largest_;           ///< the largest value of each
  double work_ = 0.0;               ///< largest internal + stored
};

}  // namespace efree
