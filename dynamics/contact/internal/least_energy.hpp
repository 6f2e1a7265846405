// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact impulses as the solution of a minimum problem.
#pragma once

#include "efree/dynamics/state.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {

/// When iterations for impulses end: where they change no velocity by more than this part of the largest that is to be
/// stopped, or after so many: products with the mobility, or sweeps over points.
struct IterationEnd {
  double tolerance;
  int most;
  bool is_exact = false;  ///< to rounding, by conjugate gradients
};
/// In motion gaps correct the rest in the next step, and modes that need more iterations hardly move the surface. Where
/// bodies come to rest that motion would not end: in such modes nodes of clouds move up to a thousand times faster than
/// points of the surface. Between bodies more iterations do not help (docs/evidence.md).
struct IterationEnds {
  IterationEnd in_motion, coming_to_rest;
};
inline constexpr IterationEnds on_walls{{1e-3, 30}, {1e-12, 300, true}}, between_bodies{{1e-3, 15}, {1e-5, 30}},
    sweeps_of_points{{1e-3, 20}, {1e-5, 40}};
template <int Dim> IterationEnd iteration_end(const World<Dim>& world, const IterationEnds& ends) {
  return world.time >= world.options.rest_from ? ends.coming_to_rest : ends.in_motion;
}

/// Accelerated projected gradients with restarts (Nesterov 1983; O'Donoghue & Candes 2015; for contact Mazhar et al.
/// 2015); see minimise_energy.
template <int R, class Mobility, class Project>
void minimise_by_accelerated_gradients(const Mobility& mobility, const Points<R>& velocities, double largest,
                                       const IterationEnd& end, const Project& project, Points<R>& impulses) {
  Points<R> ahead = impulses, next(R, mobility.size());
  double theta = 1.0;
  for (int k = 0; k < end.most; ++k) {
    const Points<R> changes = mobility.velocities(ahead);
    double squared_residual = 0.0, uphill = 0.0;
    for (Index s = 0; s < mobility.size(); ++s) {
      const double bound = mobility.bounds()[s];
      if (bound > 0.0)
        next.col(s) = project(s, Vec<R>(ahead.col(s) - (velocities.col(s) + changes.col(s)) / bound));
      else
        next.col(s).setZero();  // nothing there can move
      const Vec<R> step = bound * (ahead.col(s) - next.col(s));
      squared_residual = std::max(squared_residual, step.squaredNorm());
      uphill += step.dot(next.col(s) - impulses.col(s));
    }
    const double before = uphill > 0.0 ? 1.0 : theta;
    theta = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * before * before));
    ahead = next + (uphill > 0.0 ? 0.0 : (before - 1.0) / theta) * (next - impulses);
    impulses.swap(next);
    if (std::sqrt(squared_residual) <= end.tolerance * largest) break;
  }
}

/// Gradient steps find which impulses are at their limits, conjugate gradients those that are not (More & Toraldo
/// 1991); see minimise_energy. Which are at their limits may depend on rounding, and so do results that are not exact.
template <int R, class Mobility, class Project>
void minimise_by_conjugate_gradients(const Mobility& mobility, const Points<R>& velocities, double largest,
                                     const IterationEnd& end, const Project& project, Points<R>& impulses) {
  constexpr double reduction = 0.01;  // of the slope by conjugate gradients
  const Index n = mobility.size();
  const Vector& bounds = mobility.bounds();
  int products = 0;
  const auto times_mobility = [&](const Points<R>& of) {
    ++products;
    return mobility.velocities(of);
  };
  Points<R> slope = velocities + times_mobility(impulses), next(R, n), scaled(R, n);
  Vector free(n);  // 1 over the bound, or 0 at the limits
  const auto residual_of_free = [&] {
    return std::sqrt((free.array() > 0.0).select(slope.colwise().squaredNorm().transpose().array(), 0.0).maxCoeff());
  };
  while (products < end.most) {
    double residual = 0.0;
    for (Index s = 0; s < n; ++s) {
      next.col(s).setZero();
      free[s] = 0.0;
      if (!(bounds[s] > 0.0)) continue;  // nothing there can move
      const Vec<R> trial = impulses.col(s) - slope.col(s) / bounds[s];
      next.col(s) = project(s, trial);
      if (next.col(s) == trial) free[s] = 1.0 / bounds[s];
      residual = std::max(residual, bounds[s] * (next.col(s) - impulses.col(s)).norm());
    }
    if (residual <= end.tolerance * largest) return;
    impulses = next;
    slope = velocities + times_mobility(impulses);
    const double small = std::max(reduction * residual, 0.5 * end.tolerance * largest);
    Points<R> direction = Points<R>::Zero(R, n);
    double before = 1.0;
    while (products < end.most && residual_of_free() > small) {
      scaled = slope * free.asDiagonal();
      const double now = scaled.cwiseProduct(slope).sum();
      direction = (now / before) * direction - scaled;
      before = now;
      const Points<R> change = times_mobility(direction);
      const double curvature = direction.cwiseProduct(change).sum();
      if (!(curvature > 0.0)) break;
      next = impulses + (now / curvature) * direction;
      bool is_inside = true;
      for (Index s = 0; s < n; ++s) {
        if (!(free[s] > 0.0)) continue;
        const Vec<R> nearest = project(s, Vec<R>(next.col(s)));
        is_inside = is_inside && nearest == next.col(s);
        next.col(s) = nearest;
      }
      if (is_inside) {
        impulses = next;
        slope += (now / curvature) * change;
        continue;
      }
      const Points<R> slope_there = velocities + times_mobility(next);
      if (next.cwiseProduct(slope_there + velocities).sum() < impulses.cwiseProduct(slope + velocities).sum()) {
        impulses = next;
        slope = slope_there;
      }
      break;
    }
  }
}

/// The impulses with the least kinetic energy afterwards, of those that `project` admits.
/// mobility: size() contacts, velocities(impulses) at these by R x size() impulses, symmetric and positive, and
/// bounds() of it by contact. `velocities`: without impulses; `largest`: the scale of these; `project(contact,
/// impulse)`: the nearest admissible one; `impulses`: a first guess, and the result.
template <int R, class Mobility, class Project>
void minimise_energy(const Mobility& mobility, const Points<R>& velocities, double largest, const IterationEnd& end,
                     const Project& project, Points<R>& impulses) {
  if (end.is_exact)
    minimise_by_conjugate_gradients<R>(mobility, velocities, largest, end, project, impulses);
  else
    minimise_by_accelerated_gradients<R>(mobility, velocities, largest, end, project, impulses);
}

/// A mobility of impulses along surfaces alone, to velocities along these. normals: of the surfaces, unit vectors.
template <int Dim, class Mobility> struct TangentialMobility {
  const Mobility& all;
  const Points<Dim>& normals;

  Index size() const { return all.size(); }
  const Vector& bounds() const { return all.bounds(); }
  Points<Dim> tangential(const Points<Dim>& of) const {
    return of - normals * of.cwiseProduct(normals).colwise().sum().asDiagonal();
  }
  Points<Dim> velocities(const Points<Dim>& impulses) const { return tangential(all.velocities(impulses)); }
};

/// Likewise along their normals.
template <int Dim, class Mobility> struct NormalMobility {
  const Mobility& all;
  const Points<Dim>& normals;

  Index size() const { return all.size(); }
  const Vector& bounds() const { return all.bounds(); }
  Points<1> velocities(const Points<1>& impulses) const {
    return normals.cwiseProduct(all.velocities(normals * impulses.asDiagonal())).colwise().sum();
  }
};

/// Impulses along surfaces by which contacts slip least, by the same iteration.
/// velocities: relative ones without these impulses, of which those along the normals do not matter; normals: unit
/// vectors; most: the largest impulse of each contact; before: impulses of the last step, as a first guess.
template <int Dim, class Mobility>
Points<Dim> friction_impulses(const Mobility& mobility, const Points<Dim>& velocities, const Points<Dim>& normals,
                              const Points<1>& most, double largest, const IterationEnd& end,
                              const Points<Dim>& before) {
  const TangentialMobility<Dim, Mobility> along{mobility, normals};
  const Points<Dim> slip = along.tangential(velocities);
  Points<Dim> impulses = along.tangential(before);
  minimise_energy<Dim>(
      along, slip, std::max(largest, std::sqrt(slip.colwise().squaredNorm().maxCoeff())), end,
      [&](Index k, const Vec<Dim>& impulse) {
        const double size = impulse.norm();
        return Vec<Dim>(size > most[k] ? Vec<Dim>(most[k] / size * impulse) : impulse);
      },
      impulses);
  return impulses;
}

}  // namespace efree::internal
