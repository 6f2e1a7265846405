// SPDX-License-Identifier: GPL-3.0-or-later
/// A porous block of steel from an image, 48 mm a side, thrown against a rigid wall at 20 m/s: explicit dynamics on a
/// coarse cloud, against explicit linear finite elements on the same mesh.
///
///   rho a = div sigma,   J2 plasticity,   wall: z >= 0
///
///      | o  O |  20 m/s        nodes: a coarse cloud with geodesic weights
///      |  O  o|    |           points: quadrature of the static solver
///   ===|o__O__|====v=====      wall: stops the fine vertices
///
/// Prints the impulse on the wall on the way, how long steps are, and how many of them there were.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

namespace {

/// Impulses on the wall [N s] after every 3 us; steps are said.
Vector impulses(const char* name, const FineMesh<3>& mesh, const ApproximationOptions& options) {
  const J2 steel(
      {.moduli = {.E = 210e3, .nu = 0.3}, .yield = Hardening::linear(450.0, 129.24), .strain = Strain::finite});
  DeformableBody<3> body = deformable_body(approximate(mesh, options), steel, 7.85e-9);
  body.velocity.setZero(3, body.nodes.cols());
  body.velocity.row(2).setConstant(-20e3);
  Dynamics<3> dynamics({body}, total_lagrangian<3>());
  dynamics.add_wall({.normal = Vec<3>::Unit(2)});
  const double before = dynamics.balance().momentum[2], step = dynamics.stable_step();
  Vector result(8);
  for (Index k = 0; k < result.size(); ++k) {
    dynamics.run(3e-6 * (k + 1));
    result[k] = dynamics.balance().momentum[2] - before;
  }
  std::printf("%-10s %5d nodes, %6d points, steps of %5.1f ns, %4d of them, impulses", name, dynamics.num_nodes(),
              dynamics.num_points(), 1e9 * step, dynamics.steps());
  for (const double impulse : result) std::printf(" %.2f", impulse);
  std::printf(" N s\n");
  return result;
}

}  // namespace

int main() {
  const auto image = keep_largest(random_spheres<3>(48, {.porosity = 0.3})).image;
  const FineMesh<3> mesh(keep_largest(mesh_image<3>(image, {.size = 3.0})).mesh);
  const Vector elements = impulses("elements", mesh, {.kind = BasisKind::p1});
  const Vector cloud = impulses("cloud", mesh, {.spacing = 5.0, .support = dynamics_support});
  const double error = (cloud - elements).norm() / elements.norm();
  std::printf("impulses differ by %.1f %%\n", 100.0 * error);
  return error < 0.03 ? 0 : 1;
}
