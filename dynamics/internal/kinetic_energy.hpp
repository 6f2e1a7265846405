// SPDX-License-Identifier: GPL-3.0-or-later
/// Kinetic energy of the nodes at a time, by velocities of half a step ago.
#pragma once

#include "efree/dynamics/state.hpp"

namespace efree::internal {

/// By body: 1 where impulses of contact join it to a wall, a rigid body or a body that supports hold against gravity,
/// by itself or through other bodies; empty without gravity. before: World::contacts a step ago.
template <int Dim>
std::vector<char> find_resting_bodies(const World<Dim>& world, const std::vector<ContactImpulse<Dim>>& before);

/// By body: energy of the changes of velocities by the first impulses of a run, over that of free fall, at most 1. It
/// is 0 of bodies in balance at the start. kick: the time of these impulses.
template <int Dim> std::vector<double> find_start_shares(const World<Dim>& world, double kick);

/// Energies of the nodes now.
struct KineticEnergy {
  double kinetic = 0.0;
  double supports = 0.0;  ///< work of supports in the last half step, which the next impulses will bring
  /// 1/8 m g^2 dt^2 of bodies that rest, times what find_start_shares says: no energy, but in leapfrog's balance from a
  /// start on at which nothing held them.
  double resting = 0.0;
};

/// Leapfrog's energy, 1/2 v . (M v + dt f) with velocities v half a step ago and forces f now (theory.md): exact in
/// vibrations of constant step. Bodies that nothing holds fall with the energy of their velocity now, whatever the
/// steps: 1/8 m g^2 dt^2 is added along axes where no velocity of them, or of bodies that they are tied to, is
/// prescribed, unless they rest (1 in `resting`, by body; empty: none does). Forces do not accelerate nodes along axes
/// with prescribed velocity: their energy is 1/2 m v^2, and what the forces there have done since half a step ago is
/// the work of supports. start_shares: find_start_shares; empty: 0.
template <int Dim> KineticEnergy kinetic_energy(const World<Dim>& world, const std::vector<char>& resting,
                                                const std::vector<double>& start_shares);

}  // namespace efree::internal
