// SPDX-License-Identifier: GPL-3.0-or-later
/// The quadratic patch test: a quadratic displacement with its body force on a square, displacements prescribed all
/// around by Nitsche, one cloud with H = 0.125 on finer and finer meshes. Order 2 reproduces quadratics at the fine
/// vertices, so with full integration their linear interpolation is what remains; on quadratic cells nothing does.
/// Prints a Markdown table.
///
///   bench_quadratic_patch [finest H/h = 16]
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;

namespace {

constexpr IsotropicModuli material{1.0, 0.3};

Vec<2> displacement(const Vec<2>& x) {
  return {x.x() * x.x() + 0.5 * x.x() * x.y(), x.y() * x.y() - 0.3 * x.x() * x.x()};
}
Voigt<2> stress(const Vec<2>& x) {
  const Voigt<2> strain(2.0 * x.x() + 0.5 * x.y(), 2.0 * x.y(), 0.0, 0.5 * x.x() - 0.6 * x.x());
  static const Materials<2> materials({LinearElastic(material)}, Plane::stress);
  return materials.stiffness(0, x).C * strain;
}
/// Minus the divergence of the stress, a constant.
Vec<2> body_force(const Vec<2>&) {
  const Vec<2> O = Vec<2>::Zero(), X = Vec<2>::UnitX(), Y = Vec<2>::UnitY();
  const Voigt<2> dx = stress(X) - stress(O), dy = stress(Y) - stress(O);
  return {-dx[0] - dy[2], -dx[2] - dy[1]};
}

void row(double mesh_ratio, int order, int interpolation, SecondaryKind secondary, const char* name) {
  const double spacing = 0.125, size = spacing / mesh_ratio;
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = size});
  const auto approximation =
      approximate(mesh, {.order = order, .interpolation = interpolation, .spacing = spacing, .secondary = secondary});
  const std::array<ScalarField<2>, 2> components{[](const Vec<2>& x) { return displacement(x).x(); },
                                                 [](const Vec<2>& x) { return displacement(x).y(); }};
  std::vector<DisplacementCondition<2>> conditions;
  for (const char* side : {"left", "right", "bottom", "top"}) conditions.push_back({side, components, nullptr});
  const ElasticSolver<2> solver(approximation, {.material = LinearElastic(material), .plane = Plane::stress},
                                conditions);
  const auto solution = solver.solve({{}, body_force});
  const Errors errors =
      errors_against<2>(approximation, recover_fields(approximation, solution),
                        Materials<2>({LinearElastic(material)}, Plane::stress), {displacement, stress});
  std::printf("| %g | %d | %d | %s | %d | %.1e | %.1e | %.1e |\n", mesh_ratio, order, interpolation, name,
              approximation.shape.num_nodes(), *errors.l2_displacement, *errors.energy_norm,
              *errors.energy_norm_recovered);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const double finest = argc > 1 ? std::atof(argv[1]) : 16.0;
  std::printf(
      "| H/h | order | interpolation | secondary basis | nodes | displacement, L2 | energy norm | recovered stress "
      "|\n");
  std::printf("|---|---|---|---|---|---|---|---|\n");
  for (const auto& [secondary, name] : {std::pair{SecondaryKind::full, "full"}, {SecondaryKind::cells, "cells"}})
    for (const int order : {1, 2})
      for (const int interpolation : {1, 2})
        for (double mesh_ratio = 4.0; mesh_ratio <= finest; mesh_ratio *= 2.0)
          row(mesh_ratio, order, interpolation, secondary, name);
}
