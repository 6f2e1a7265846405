// SPDX-License-Identifier: GPL-3.0-or-later
/// Stable time steps of particles with artificial viscosity.
#pragma once

#include "efree/core/types.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"

#include <cmath>

namespace efree::internal {

/// Fastest rate at which a linear viscosity of one damps waves on a square (cubic) lattice of particles, times the
/// smoothing length over the speed of pressure waves.
template <int Dim> double damping_on_lattice(const SphOptions& options);

/// Stable step of leapfrog for an angular frequency and a rate of damping whose forces lag behind by half a step: the
/// smaller root of frequency^2 dt^2 + 2 rate dt = 4.
inline double damped_step(double frequency, double rate) {
  return 4.0 / (rate + std::sqrt(rate * rate + 4.0 * frequency * frequency));
}

}  // namespace efree::internal
