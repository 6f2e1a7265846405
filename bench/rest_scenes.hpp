// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that are pressed slowly, or start at rest, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace efree::bench {

/// A round seal of rubber, radius 1, between two plates with friction that close by that part of its height.
struct Seal {
  double spacing = 0.1;
  double friction = 0.3;
  double closed = 0.3;  ///< over the height
  double time = 100.0;  ///< of the closing; waves take 2 across
  double damping = 0.3;
};

/// The force of the upper plate on the seal at these equal parts of the way, means over a tenth of a part.
inline std::vector<double> press_seal(const Seal& of, int parts) {
  PlanarDomain disk{.boundary = {{"rim", {}}}};
  const int corners = std::max(16, static_cast<int>(std::ceil(2.0 * std::numbers::pi / of.spacing)));
  for (int k = 0; k <= corners; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k % corners) / corners;
    disk.boundary[0].points.emplace_back(std::cos(angle), std::sin(angle));
  }
  DynamicsOptions options;
  options.damping = of.damping;
  Dynamics<2> dynamics(
      {deformable_body(triangulate(disk, {.size = of.spacing}), NeoHookean({.E = 1.0, .nu = 0.45}), 1.0)}, otm<2>(),
      options);
  for (const double side : {-1.0, 1.0})
    dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, -side}, -1.0),
                             .friction = of.friction,
                             // The way is closed (1 - cos(pi t / time)) / 2 of each half.
                             .velocity = [=](double t) {
                               const double rate = std::numbers::pi / of.time;
                               return Vec<2>(0.0,
                                             -side * of.closed * 0.5 * rate * std::sin(rate * std::min(t, of.time)));
                             }});
  const auto when = [&](double way) { return of.time * std::acos(1.0 - 2.0 * way) / std::numbers::pi; };
  std::vector<double> forces;
  for (int k = 1; k <= parts; ++k) {
    const double from = when((k - 0.1) / parts), to = when(static_cast<double>(k) / parts);
    dynamics.run(from);
    const double before = dynamics.rigid_bodies()[1].impulse[1];
    dynamics.run(to);
    forces.push_back((dynamics.rigid_bodies()[1].impulse[1] - before) / (to - from));
  }
  return forces;
}

}  // namespace efree::bench
