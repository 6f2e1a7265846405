// SPDX-License-Identifier: GPL-3.0-or-later
/// Particles become several smaller ones where they are strained.
#pragma once

#include "efree/dynamics/schemes/sph/internal/wall_images.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"

namespace efree::internal {

/// Numbers by particle that splitting changes.
struct ParticleSizes {
  Vector smoothing;                  ///< smoothing lengths
  std::vector<std::uint8_t> splits;  ///< how often a particle and its parents have been split
  std::vector<WallBits> pressed;     ///< the walls that it is pressed on
};

/// Splits the particles that are strained beyond the threshold; returns how many. Mass, momentum, kinetic and stored
/// energy stay what they are, and angular momentum to rounding. The world's nodes, points and prescribed velocities are
/// complete afterwards.
template <int Dim> Index split_particles(World<Dim>& world, const ParticleSplitting& options, ParticleSizes& sizes);

}  // namespace efree::internal
