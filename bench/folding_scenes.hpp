// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that fold onto themselves, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

namespace efree::bench {

/// How deep the nodes of a body are in cells that they are no corner of, at most, over the spacing.
template <int Dim> double self_penetration(const Dynamics<Dim>& dynamics) {
  const auto& world = dynamics.world();
  const Points<Dim>& x = dynamics.nodes();
  double deepest = 0.0;
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    const auto corners = (world.bodies[b].cells.array() + dynamics.first_node(b)).eval();
    for (Index c = 0; c < corners.cols(); ++c) {
      const Vec<Dim> first = x.col(corners(0, c));
      Mat<Dim> edges;
      for (int i = 0; i < Dim; ++i) edges.col(i) = x.col(corners(i + 1, c)) - first;
      const Mat<Dim> inverse = edges.inverse();  // its rows are gradients of shape functions
      const double reach = std::sqrt(edges.colwise().squaredNorm().maxCoeff());
      for (const Index a : world.nodes_of(b)) {
        const Vec<Dim> at = x.col(a) - first;
        if (at.norm() > reach || (corners.col(c) == a).any()) continue;
        const Vec<Dim> weights = inverse * at;
        const double last = 1.0 - weights.sum();
        if (!(weights.minCoeff() > 0.0) || !(last > 0.0)) continue;
        double depth = last / inverse.colwise().sum().norm();
        for (int i = 0; i < Dim; ++i) depth = std::min(depth, weights[i] / inverse.row(i).norm());
        deepest = std::max(deepest, depth / world.nodes.spacing[a]);
      }
    }
  }
  return deepest;
}

struct Folding {
  double penetration = 0.0;   ///< the largest so far, as self_penetration
  double energy_error = 0.0;  ///< the largest
  double contact = 0.0;       ///< energy lost in contact, over the largest
};

/// Runs to the end, and looks for penetration in every tenth step.
template <int Dim> Folding fold(Dynamics<Dim>& dynamics, double end) {
  Folding result;
  while (dynamics.time() < end) {
    dynamics.step(dynamics.step_towards(end - dynamics.time()));
    if (dynamics.steps() % 10 == 0 || !(dynamics.time() < end))
      result.penetration = std::max(result.penetration, self_penetration(dynamics));
  }
  const EnergyWatch watch = dynamics.energy();
  result.energy_error = watch.largest_error();
  result.contact = dynamics.balance()["contact"] / watch.scale;
  return result;
}

/// Material of Young's modulus 1 and density 1, so that waves along bars travel 1 in a time of 1.
inline SharedMaterial folding_rubber() {
  return NeoHookean({.E = 1.0, .nu = 0.3});
}

/// A U whose arms, 2 long, 0.3 thick and 0.3 apart, swing at each other and meet at their tips.
inline Dynamics<2> closing_u(double spacing, double friction = 0.0) {
  const double a = 0.15, b = 0.45;
  const PlanarDomain u{
      .boundary = {
          {"", {{-b, -0.3}, {b, -0.3}, {b, 2.0}, {a, 2.0}, {a, 0.0}, {-a, 0.0}, {-a, 2.0}, {-b, 2.0}, {-b, -0.3}}}}};
  DeformableBody<2> body = deformable_body(triangulate(u, {.size = spacing}), folding_rubber(), 1.0);
  body.velocity.setZero(2, body.nodes.cols());
  for (Index k = 0; k < body.nodes.cols(); ++k)
    if (body.nodes(1, k) > 0.0) body.velocity(0, k) = (body.nodes(0, k) > 0.0 ? -0.15 : 0.15) * body.nodes(1, k);
  Dynamics<2> dynamics({body}, otm<2>(), {.contact = {.friction = friction}});
  for (const int axis : {0, 1}) dynamics.prescribe([](const Vec<2>& x) { return x[1] < -0.3 + 1e-9; }, axis, 0.0);
  return dynamics;
}

/// A tube, radii 0.4 and 0.5, that two plates press flat until its inner sides lie on each other.
inline Dynamics<2> flattened_tube(double spacing, double friction = 0.0) {
  const auto mesh = triangulate(shapes::annulus(0.4, 0.5, spacing), {.size = spacing});
  Dynamics<2> dynamics({deformable_body(mesh, folding_rubber(), 1.0)}, otm<2>(), {.contact = {.friction = friction}});
  for (const double side : {-1.0, 1.0})
    dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, -side}, -0.501),
                             .friction = friction,
                             .velocity = [side](double t) { return Vec<2>(0.0, t < 4.0 ? -0.1 * side : 0.0); }});
  return dynamics;
}

/// A sheet, 1 high and 0.06 thick, between two walls, that is pushed down until it lies in folds.
inline Dynamics<3> crumpled_sheet(double spacing, double friction = 0.0) {
  const FineMesh<3> mesh(solids::box({0.06, 0.18, 1.0}, spacing));
  DeformableBody<3> body = deformable_body(mesh, folding_rubber(), 1.0);
  body.velocity.setZero(3, body.nodes.cols());
  for (Index k = 0; k < body.nodes.cols(); ++k)
    body.velocity(0, k) = 0.02 * std::sin(2.0 * std::numbers::pi * body.nodes(2, k));
  Dynamics<3> dynamics({body}, otm<3>(), {.contact = {.friction = friction}});
  dynamics.add_wall({.normal = {1.0, 0.0, 0.0}, .level = -0.15});
  dynamics.add_wall({.normal = {-1.0, 0.0, 0.0}, .level = -0.21});
  for (const int axis : {0, 1, 2}) dynamics.prescribe([](const Vec<3>& x) { return x[2] < 1e-9; }, axis, 0.0);
  for (const int axis : {0, 1}) dynamics.prescribe([](const Vec<3>& x) { return x[2] > 1.0 - 1e-9; }, axis, 0.0);
  dynamics.prescribe([](const Vec<3>& x) { return x[2] > 1.0 - 1e-9; }, 2, -0.1);
  return dynamics;
}

}  // namespace efree::bench
