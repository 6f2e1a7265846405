// SPDX-License-Identifier: GPL-3.0-or-later
/// Sums over pairs of particles and images that walls have of them. A wall pushes, and holds nothing: images act on
/// particles, and are of particles, that are pressed on it.
#pragma once

#include "efree/dynamics/scheme.hpp"
#include "efree/dynamics/schemes/sph/internal/pair_kernels.hpp"

namespace efree::internal {

/// Particles of the world, as sums over images take them.
template <int Dim> struct MirroredParticles {
  const std::vector<WallImage<Dim>>& images;
  SmoothingKernel kernel;
  const Points<Dim>&x, &v;
  double ago;  ///< they are where they were that time ago by these velocities
  const Vector &mass, &smoothing;
  const std::vector<WallBits>& pressed;  ///< by particle: the walls that it is pressed on
};

/// Adds what images contribute to the rates and moments of sum_rates; either may be none.
template <int Dim>
void add_mirrored_rates(const ParticlePairs& pairs, const MirroredParticles<Dim>& of, double* rates, double* moments);

/// Adds what images contribute to sum_forces, the adjoint of the rates, and viscosity; artificial stress is between
/// particles alone. by: by particle of the world, stresses by Dim Dim numbers. wall_forces: by wall its part of the
/// forces is added; none: it is not wanted. Of images by walls at right angles each has the part along its normal, and
/// the first what is left.
template <int Dim> LostPower add_mirrored_forces(const ParticlePairs& pairs, const MirroredParticles<Dim>& of,
                                                 const PairForces& by, const std::vector<Wall<Dim>>& walls,
                                                 double* forces, WallForces<Dim>* wall_forces);

}  // namespace efree::internal
