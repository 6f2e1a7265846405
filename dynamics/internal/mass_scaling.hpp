// SPDX-License-Identifier: GPL-3.0-or-later
/// Masses that make stable steps longer (MassScaling).
#pragma once

#include "efree/dynamics/internal/stable_step.hpp"

namespace efree::internal {

/// Adds mass to the points whose bound on the stable step is below MassScaling::step, until the stable step of all is
/// that long; nothing where it is. Estimates world.stable_step again. The bound of a point is that of its own stiffness
/// and mass (Irons & Treharne 1971), times one factor for all points such that the least bound is the stable step.
/// Throws InputError by schemes whose nodes do not persist.
template <int Dim> void add_masses(World<Dim>& world, Scheme<Dim>& scheme, StableStep<Dim>& stable);
/// Masses of a state with another mass scaling become those of world.options.
template <int Dim>
void change_mass_scaling(World<Dim>& world, Scheme<Dim>& scheme, StableStep<Dim>& stable, const MassScaling& before);
/// Masses by body.
template <int Dim> std::vector<BodyMass> body_masses(const World<Dim>& world);
/// Samples of World::added_inertia, by mean velocities of the material points over the time that a pressure wave takes
/// through the body where it is the shortest, and 16 steps at least: nodes in contact chatter from step to step, scaled
/// or not. Before the first of these means are the velocities of the first step: loads that act at once are seen, also
/// where damping stops what they excite within the second interval.
template <int Dim> class InertiaSampling {
 public:
  /// Positions at the start, and that time.
  void begin(const World<Dim>& world);
  /// After every step.
  void sample(const World<Dim>& world, AddedInertia& to);
  void pack(Archive& archive) { archive(start_, x_, v_, time_, interval_, step_); }

 private:
  static Points<Dim> positions(const World<Dim>& world);
  InertiaSample measure(const World<Dim>& world, const Points<Dim>& v, const Points<Dim>& a) const;

  Points<Dim> start_;      ///< Dim x M, of points: positions at the start
  Points<Dim> x_, v_;      ///< Dim x M: positions, mean velocities before; empty: not known
  double time_ = 0.0;      ///< of the last sample
  double interval_ = 0.0;  ///< [time]
  Index step_ = 0;         ///< of the last sample
};

}  // namespace efree::internal
