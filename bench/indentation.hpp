// SPDX-License-Identifier: GPL-3.0-or-later
/// A rigid ball that is pressed slowly into an elastic half-space, axisymmetric, beside Hertz's (1882) force
/// 4/3 E* sqrt(R) d^(3/2), for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <cmath>
#include <numbers>
#include <random>

namespace efree::bench {

/// Lengths in contact radii, stresses in Young's moduli. The half-space ends at 100 contact radii, where it is held: by
/// what a point load does there that makes it stiffer by a hundredth.
struct Indentation {
  static constexpr double radius = 25.0, depth = 1.0 / radius, far = 100.0, nu = 0.3;

  /// Half of a ball's section below y = 0, nodes on its axis, cells that grow with the distance from the origin. Nodes
  /// inside are off a lattice by up to `careless` of its spacing, whose squares are cut along either diagonal then.
  static FineMesh<2> mesh(Index n, double careless = 0.0) {
    const auto vertex = [n](Index i, Index j) { return i + j * (n + 1); };
    MeshData<2> data;
    data.vertices.resize(2, (n + 1) * (n + 1));
    data.cells.resize(3, 2 * n * n);
    std::mt19937 random(static_cast<unsigned>(n));
    std::uniform_real_distribution<double> uniform(-careless, careless);
    Index c = 0;
    for (Index j = 0; j <= n; ++j)
      for (Index i = 0; i <= n; ++i) {
        double u = static_cast<double>(i) / n, w = static_cast<double>(j) / n;
        if (careless > 0.0 && i > 0 && i < n && j > 0 && j < n) {
          u += uniform(random) / n;
          w += uniform(random) / n;
        }
        const Vec<2> disk(u * std::sqrt(1.0 - 0.5 * w * w), -w * std::sqrt(1.0 - 0.5 * u * u));
        const double s = disk.norm();
        data.vertices.col(vertex(i, j)).setZero();
        if (s > 0.0) data.vertices.col(vertex(i, j)) = far * std::sinh(growth * s) / std::sinh(growth) / s * disk;
        if (i == n || j == n) continue;
        const Index a = vertex(i, j), b = vertex(i + 1, j), d = vertex(i, j + 1), e = vertex(i + 1, j + 1);
        const bool is_corner = i == n - 1 && j == n - 1;  // flat if cut the other way
        if (careless > 0.0 && !is_corner && uniform(random) > 0.0) {
          data.cells.col(c++) << a, e, b;
          data.cells.col(c++) << a, d, e;
        } else {
          data.cells.col(c++) << a, d, b;
          data.cells.col(c++) << b, d, e;
        }
      }
    return FineMesh<2>(std::move(data));
  }
  /// Of its nodes at the origin.
  static double spacing(Index n) { return far * growth / std::sinh(growth) / n; }

  struct Answer {
    double force;   ///< over Hertz's
    double energy;  ///< error of the balance, over the work
    Index steps;
  };
  /// Pressed within three times that a wave takes to the end; the force is the mean over two more.
  static Answer press(Index n, const OtmOptions& scheme = {}, double careless = 0.0, DynamicsOptions options = {}) {
    options.plane = Plane::axisymmetric;
    Dynamics<2> dynamics({deformable_body(mesh(n, careless), NeoHookean({.E = 1.0, .nu = nu}), 1.0, true)},
                         otm<2>(scheme), options);
    const double crossing = far / std::sqrt((1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))), ramp = 3.0 * crossing;
    for (Index a = 0; a < dynamics.num_nodes(); ++a) {
      const Vec<2> x = dynamics.nodes().col(a);
      for (int i = 0; i < 2; ++i)
        if (x.norm() > 0.999 * far || (i == 0 && x[0] == 0.0)) dynamics.prescribe(a, i, 0.0);
    }
    dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>({0.0, radius}, radius), .velocity = [ramp](double t) {
                               const double s = std::sin(std::numbers::pi * t / ramp);
                               return Vec<2>(0.0, t < ramp ? -2.0 * depth / ramp * s * s : 0.0);
                             }});
    dynamics.run(ramp);
    const double before = dynamics.rigid_bodies()[0].impulse[1];
    dynamics.run(ramp + 2.0 * crossing);
    const double force = (dynamics.rigid_bodies()[0].impulse[1] - before) / (2.0 * crossing);
    const double hertz = 4.0 / 3.0 / (1.0 - nu * nu) * std::sqrt(radius) * std::pow(depth, 1.5);
    return {force / hertz, dynamics.balance().total() / dynamics.balance()["prescribed"], dynamics.steps()};
  }

 private:
  static constexpr double growth = 6.0;
};

}  // namespace efree::bench
