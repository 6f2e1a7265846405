// SPDX-License-Identifier: GPL-3.0-or-later
/// Taylor's bar: copper that hits a rigid wall at 227 m/s: explicit dynamics by the optimal-transportation
/// meshfree method, in a meridian section.
///
///   rho a = div sigma,   J2 plasticity with logarithmic strains, friction at the wall none
///
///        |~~~~~|  227 m/s
///     axis     |     |
///        |     |     v
///     ===|=====|==========  wall: z >= 0
///
/// Prints length and foot on the way, against published computations, and the energies at the end.
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

int main() {
  const double radius = 3.2e-3, length = 32.4e-3, speed = 227.0;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, radius, length), {.size = 0.8e-3});
  const J2 copper(
      {.moduli = {.E = 117e9, .nu = 0.35}, .yield = Hardening::linear(400e6, 100e6), .strain = Strain::finite});

  DeformableBody<2> bar = deformable_body(mesh, copper, 8930.0, true);
  bar.velocity.setZero(2, bar.nodes.cols());
  bar.velocity.row(1).setConstant(-speed);
  Dynamics<2> dynamics({bar}, otm<2>(), {.plane = Plane::axisymmetric});
  dynamics.add_wall({.normal = {0.0, 1.0}});
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    if (bar.nodes(0, a) == 0.0) dynamics.prescribe(a, 0, 0.0);

  const double kinetic = dynamics.balance()["kinetic"];
  std::printf("%d nodes, %d material points, %.2f J\n", dynamics.num_nodes(), dynamics.num_points(), kinetic);
  double foot = 0.0, top = 0.0;
  for (const double time : {20e-6, 40e-6, 80e-6}) {
    dynamics.run(time);
    top = dynamics.nodes().row(1).maxCoeff();
    foot = dynamics.nodes().row(0).maxCoeff();
    std::printf("%2.0f us: length %.1f mm, foot %.1f mm, plastic strain up to %.1f\n", 1e6 * time, 1e3 * top,
                1e3 * foot, dynamics.history(0).row(6).maxCoeff());
  }
  const auto now = dynamics.balance();
  std::printf("energy: %.0f %% plastic work, %.0f %% elsewhere, %.1f %% not accounted for\n",
              100.0 * now["dissipated"] / kinetic, 100.0 * (now.total() - now["dissipated"]) / kinetic,
              100.0 * (now.total() / kinetic - 1.0));
  return top > 21.4e-3 && top < 21.7e-3 && foot > 6.9e-3 && foot < 7.3e-3 ? 0 : 1;
}
