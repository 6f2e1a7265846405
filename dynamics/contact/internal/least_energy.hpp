// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact impulses as the solution of a minimum problem.
#pragma once

#include "efree/dynamics/state.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {

/// When iterations for impulses end: where they change no velocity by more than this part of the largest that is to be
/// stopped, or after so many.
struct IterationEnd {
  double tolerance;
  int most;
};
/// By default gaps correct the rest in the next step, and modes that need more iterations hardly move the surface.
/// Where bodies come to rest that motion would not end; with half of the gradient steps clouds at rest creep on rough
/// walls.
template <int Dim> IterationEnd iteration_end(const World<Dim>& world, int most) {
  const bool comes_to_rest = world.time >= world.options.rest_from;
  return {comes_to_rest ? 1e-5 : 1e-3, comes_to_rest ? 2 * most : most};
}
/// Most gradient steps for clouds on walls, and between bodies, where more do not help (docs/evidence.md); most sweeps
/// over points.
inline constexpr int most_steps_on_walls = 30, most_steps_between_bodies = 15, most_sweeps_of_points = 20;

/// The impulses with the least kinetic energy afterwards, of those that `project` admits (accelerated projected
/// gradients with restarts: Nesterov 1983; O'Donoghue & Candes 2015; for contact Mazhar et al. 2015).
/// mobility: size() contacts, velocities(impulses) at these by R x size() impulses, symmetric and positive, and
/// bounds() of it by contact. `velocities`: without impulses; `largest`: the scale of these; `project(contact,
/// impulse)`: the nearest admissible one; `impulses`: a first guess, and the result.
template <int R, class Mobility, class Project>
void minimise_energy(const Mobility& mobility, const Points<R>& velocities, double largest, const IterationEnd& end,
                     const Project& project, Points<R>& impulses) {
  Points<R> ahead = impulses;
  double theta = 1.0;
  for (int k = 0; k < end.most; ++k) {
    const Points<R> slope = velocities + mobility.velocities(ahead);
    Points<R> next(R, mobility.size());
    double residual = 0.0, uphill = 0.0;
    for (Index s = 0; s < mobility.size(); ++s) {
      const double bound = mobility.bounds()[s];
      if (bound > 0.0)
        next.col(s) = project(s, Vec<R>(ahead.col(s) - slope.col(s) / bound));
      else
        next.col(s).setZero();  // nothing there can move
      const Vec<R> step = bound * (ahead.col(s) - next.col(s));
      residual = std::max(residual, step.norm());
      uphill += step.dot(next.col(s) - impulses.col(s));
    }
    const double before = uphill > 0.0 ? 1.0 : theta;
    theta = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * before * before));
    ahead = next + (uphill > 0.0 ? 0.0 : (before - 1.0) / theta) * (next - impulses);
    impulses = next;
    if (residual <= end.tolerance * largest) break;
  }
}

/// Impulses along surfaces by which contacts slip least, by the same iteration.
/// velocities: relative ones without these impulses, of which those along the normals do not matter; normals: unit
/// vectors; most: the largest impulse of each contact; before: impulses of the last step, as a first guess.
template <int Dim, class Mobility>
Points<Dim> friction_impulses(const Mobility& mobility, const Points<Dim>& velocities, const Points<Dim>& normals,
                              const Points<1>& most, double largest, const IterationEnd& end,
                              const Points<Dim>& before) {
  const auto tangential = [&](Index k, const Vec<Dim>& of) {
    return Vec<Dim>(of - of.dot(normals.col(k)) * normals.col(k));
  };
  Points<Dim> slip(Dim, mobility.size()), impulses(Dim, mobility.size());
  for (Index k = 0; k < mobility.size(); ++k) {
    slip.col(k) = tangential(k, velocities.col(k));
    impulses.col(k) = tangential(k, before.col(k));
  }
  minimise_energy<Dim>(
      mobility, slip, std::max(largest, std::sqrt(slip.colwise().squaredNorm().maxCoeff())), end,
      [&](Index k, const Vec<Dim>& impulse) {
        const Vec<Dim> wanted = tangential(k, impulse);
        const double size = wanted.norm();
        return Vec<Dim>((size > most[k] ? most[k] / size : 1.0) * wanted);
      },
      impulses);
  return impulses;
}

}  // namespace efree::internal
