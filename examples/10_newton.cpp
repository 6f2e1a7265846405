// SPDX-License-Identifier: GPL-3.0-or-later
/// A rubber sheet in plane strain, stretched to three times its length in steps that Newton's method solves.
///
///   div P = 0,   P = mu (F - F^-T) + lambda ln(J) F^-T   (compressible neo-Hookean)
///
///     o |-----------| ->   right: u_x = 4 t
///     o |___________| ->   left:  u_x = 0
///        o o o o o o       bottom: u_y = 0, top: P n = 0
///
/// Prints the force along the path and its error against the closed form, P_yy = 0.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

constexpr double lambda = 1.3, mu = 0.7;

/// The force per area that stretches the sheet.
double pull(double stretch) {
  double across = 1.0 / stretch;  // the stretch with mu (across - 1 / across) + lambda ln(J) / across = 0
  for (int k = 0; k < 50; ++k) {
    const double log_J = std::log(stretch * across), square = across * across;
    across -= (mu * (across - 1.0 / across) + lambda * log_J / across) /
              (mu * (1.0 + 1.0 / square) + lambda * (1.0 - log_J) / square);
  }
  return mu * (stretch - 1.0 / stretch) + lambda * std::log(stretch * across) / stretch;
}

int main() {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  const Approximation<2> sheet = approximate(mesh, {.spacing = 0.3});
  const NonlinearEquilibrium<2> equations(
      sheet, {.material = NeoHookean({.mu = mu, .lambda = lambda}), .plane = Plane::strain},
      Program<2>::grows(
          {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), {"right", {}, [](const Vec<2>&) { return 4.0; }}}));
  Cholesky solver;
  double error = 0.0;
  follow(equations, solver, equations.rest(), {.step = 0.2}, [&](const PathStep& step) {
    const State& state = step.now.state;
    const double force = equations.reactions(state).at("right").force[0], exact = pull(1.0 + 2.0 * state.time);
    error = std::max(error, std::abs(force - exact));
    std::printf("stretched to %.2f: force %.6f, error %.1e, %d iterations, out of balance %.1e\n",
                1.0 + 2.0 * state.time, force, force - exact, step.now.iterations(), step.now.residuals.back());
  });
  return error < 1e-8 ? 0 : 1;
}
