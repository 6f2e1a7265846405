// SPDX-License-Identifier: GPL-3.0-or-later
/// The quadratic patch test: a quadratic displacement with its body force on a square, displacements prescribed all
/// around by Nitsche, one cloud with H = 0.125 on finer and finer meshes. Order 2 reproduces quadratics at the fine
/// vertices, so with full integration their linear interpolation is what remains; on quadratic cells nothing does.
/// Prints a Markdown table.
///
///   bench_quadratic_patch [finest H/h = 16]
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/tests/bodies.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;

namespace {

const LinearElastic material(1.0, 0.3);
const auto field = testing::quadratic_fields<2>()[1];

Voigt<2> stress(const Vec<2>& x) {
  return testing::hooke<2>({1.0, 0.3}, Plane::stress) * testing::strain_of_gradient<2>(field.gradient(x));
}
/// Minus the divergence of the stress, a constant.
Vec<2> body_force(const Vec<2>&) {
  Vec<2> force = Vec<2>::Zero();
  for (int j = 0; j < 2; ++j) force -= traction<2>(stress(Vec<2>::Unit(j)) - stress(Vec<2>::Zero()), Vec<2>::Unit(j));
  return force;
}

void row(double mesh_ratio, int order, int interpolation, SecondaryKind secondary) {
  const double spacing = 0.125, size = spacing / mesh_ratio;
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = size});
  const auto approximation =
      approximate(mesh, {.order = order, .interpolation = interpolation, .spacing = spacing, .secondary = secondary});
  const VectorField<2> displacement = [](const Vec<2>& x) { return field.displacement(x); };
  std::vector<DisplacementCondition<2>> conditions;
  for (const char* side : {"left", "right", "bottom", "top"})
    conditions.push_back(testing::displacement<2>(side, displacement));
  const ElasticModel model{.material = material, .plane = Plane::stress};
  const auto solution = ElasticSolver<2>(approximation, model, conditions).solve({{}, body_force});
  const Errors errors = errors_against<2>(approximation, recover_fields(approximation, solution),
                                          materials_of(model, mesh), {displacement, stress});
  std::printf("| %g | %d | %d | %s | %d | %.1e | %.1e | %.1e |\n", mesh_ratio, order, interpolation,
              testing::name_of(secondary), approximation.shape.num_nodes(), *errors.l2_displacement,
              *errors.energy_norm, *errors.energy_norm_recovered);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const double finest = argc > 1 ? std::atof(argv[1]) : 16.0;
  std::printf(
      "| H/h | order | interpolation | secondary basis | nodes | displacement, L2 | energy norm | recovered stress "
      "|\n");
  std::printf("|---|---|---|---|---|---|---|---|\n");
  for (const auto secondary : {SecondaryKind::full, SecondaryKind::cells, SecondaryKind::linear})
    for (const int order : {1, 2})
      for (const int interpolation : {1, 2})
        for (double mesh_ratio = 4.0; mesh_ratio <= finest; mesh_ratio *= 2.0)
          row(mesh_ratio, order, interpolation, secondary);
}
