// SPDX-License-Identifier: GPL-3.0-or-later
/// Blocks of rubber and bars that vibrate, for tests and benchmarks of explicit dynamics.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <cmath>
#include <limits>
#include <numbers>

namespace efree::bench {

/// Rubber with Young's modulus 1.
inline SharedMaterial soft(double nu = 0.3) {
  return NeoHookean({.E = 1.0, .nu = nu});
}

/// A careless mesh of a block, length x 1 (x 1).
template <int Dim> FineMesh<Dim> block(double length, double size) {
  if constexpr (Dim == 2)
    return triangulate(shapes::rectangle(0.0, 0.0, length, 1.0), {.size = size});
  else
    return FineMesh<3>(solids::box({length, 1.0, 1.0}, size));
}

/// Free vibration of a bar with free ends, u = cos(pi x / L), in steps of at most that: its frequency over pi c / L,
/// less one. By the total Lagrangian scheme if the body has shape functions.
template <int Dim> double frequency_error(DeformableBody<Dim> body, double length, const OtmOptions& scheme = {},
                                          const DynamicsOptions& options = {},
                                          double at_most = std::numeric_limits<double>::infinity()) {
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a)
    body.velocity(0, a) = std::cos(std::numbers::pi * body.nodes(0, a) / length);
  const Points<Dim> shape = body.velocity;
  body.velocity *= 1e-4;
  Dynamics<Dim> dynamics({body}, body.shape ? total_lagrangian<Dim>() : otm<Dim>(scheme), options);
  // The mode's velocity passes zero at odd quarters of a period: for the eighth time at 15 / 4 of one.
  double last = 1.0, last_time = 0.0, crossing = 0.0;
  for (int crossings = 0; crossings < 8;) {
    const double dt = dynamics.step(at_most), time = dynamics.time() - 0.5 * dt;
    const double now = (dynamics.velocities().cwiseProduct(shape) * dynamics.masses().asDiagonal()).sum();
    if (now * last < 0.0) {
      ++crossings;
      crossing = last_time + (time - last_time) * last / (last - now);
    }
    last = now;
    last_time = time;
  }
  return 2.0 * length / (crossing / 3.75) - 1.0;
}

}  // namespace efree::bench
