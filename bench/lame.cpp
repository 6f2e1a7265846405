// SPDX-License-Identifier: GPL-3.0-or-later
/// Thick cylinder and sphere under internal pressure: sections and solids against Lame's closed form, errors at the
/// inner wall and over the body, by nodes through the wall, equally spaced or denser towards the inner wall: the
/// largest of the clouds. Seconds are those of one run, without the mesh and the recovery. Writes a table (Markdown) to
/// standard output.
///
///   bench_lame [most nodes through the wall = 8] [most for solids = 8] [clouds = 3] [points per node = 0: default]
///              [growth of the spacing from the inner wall = 0.2]
#include "efree/bench/lame.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <ctime>

using namespace efree;
using bench::ThickWall;

namespace {

struct Method {
  const char* name;
  BasisKind kind = BasisKind::mls;
  SecondaryKind secondary = SecondaryKind::cells;
  int order = 1;
  bool graded = false;
  // Fine edges to a spacing. Graded solids have as many fine cells with 2.5 as uniform ones with 1.5.
  double section_ratio = 4.0, solid_ratio = 1.5;
};
const Method methods[] = {
    {.name = "cells"},
    {.name = "cells, order 2", .order = 2},
    {.name = "MLS", .secondary = SecondaryKind::mls},
    {.name = "cells, graded", .graded = true, .section_ratio = 2.5, .solid_ratio = 2.5},
    {.name = "cells, graded, order 2", .order = 2, .graded = true, .section_ratio = 2.5, .solid_ratio = 2.5},
    // Elements with as many nodes through the wall: P2 has one at the middle of every edge.
    {.name = "P1", .kind = BasisKind::p1, .section_ratio = 1.0 / 1.2, .solid_ratio = 1.0 / 1.2},
    {.name = "P2", .kind = BasisKind::p2, .section_ratio = 0.5 / 1.2, .solid_ratio = 0.5 / 1.2},
    {.name = "P1, graded", .kind = BasisKind::p1, .graded = true, .solid_ratio = 1.0 / 1.2},
    {.name = "P2, graded", .kind = BasisKind::p2, .graded = true, .solid_ratio = 0.5 / 1.2}};

template <int Dim>
void run(const ThickWall& wall, const Method& method, int through, int clouds, double ratio, double growth) {
  const bool elements = method.kind != BasisKind::mls;
  if (elements && method.graded && Dim == 2) return;  // triangulate has one size
  const auto spacing = ThickWall::spacing(through, method.graded ? growth : 0.0);
  const double height = 4.0 / (through - 1);
  const double ratio_of_mesh = Dim == 2 ? method.section_ratio : method.solid_ratio;
  const auto mesh = wall.mesh<Dim>(height, spacing.at_outer / ratio_of_mesh, spacing.at_inner / ratio_of_mesh);
  ApproximationOptions options{.kind = method.kind,
                               .axisymmetric = Dim == 2,
                               .order = method.order,
                               .spacing = spacing.at_outer,
                               .grading = spacing.grading,
                               .secondary = method.secondary,
                               .ratio = ratio};
  std::array<double, 7> largest{};
  double seconds = 0.0;
  Index nodes = 0;
  if (elements) clouds = 1;
  for (int seed = 1; seed <= clouds; ++seed) {
    options.seed = static_cast<std::uint64_t>(seed);
    const std::clock_t start = std::clock();
    const auto approximation = approximate(mesh, options);
    // The symmetry planes of the sphere are flat, so that elements can hold them at their nodes.
    const auto solver = wall.solver<Dim>(approximation, elements ? Essential::strong : Essential::nitsche);
    const Solution<Dim> solution = solver.solve(wall.loads<Dim>());
    seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / clouds;
    nodes = std::max(nodes, static_cast<Index>(approximation.nodes.cols()));
    const auto errors = wall.errors<Dim>(approximation, solution);
    const std::array<double, 7> found{errors.displacement.mean,
                                      errors.displacement.worst,
                                      errors.hoop.mean,
                                      errors.hoop.worst,
                                      *errors.body.l2_displacement,
                                      *errors.body.energy_norm,
                                      *errors.body.energy_norm_recovered};
    std::ranges::transform(largest, found, largest.begin(), [](double a, double b) { return std::max(a, b); });
  }
  std::printf("| %s | %s | %s | %d | %d | %d | %.2f %% | %.2f %% | %.2f %% | %.2f %% | %.1e | %.1e | %.1e | %.2f |\n",
              wall.sphere ? "sphere" : "cylinder", Dim == 2 ? "axisymmetric" : "3D", method.name, through, nodes,
              mesh.num_cells(), 100.0 * largest[0], 100.0 * largest[1], 100.0 * largest[2], 100.0 * largest[3],
              largest[4], largest[5], largest[6], seconds);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int most = argc > 1 ? std::atoi(argv[1]) : 8;
  const int most_solid = argc > 2 ? std::atoi(argv[2]) : 8;
  const int clouds = argc > 3 ? std::atoi(argv[3]) : 3;
  const double ratio = argc > 4 ? std::atof(argv[4]) : 0.0;
  const double growth = argc > 5 ? std::atof(argv[5]) : Grading{}.growth;
  std::printf(
      "| body | analysis | method | nodes through the wall | nodes | fine cells | displacement at the "
      "inner wall, mean | worst | hoop stress there, mean | worst | displacement, L2 | energy norm | recovered | CPU s "
      "|\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const bool sphere : {false, true})
    for (const Method& method : methods) {
      const ThickWall wall{sphere};
      for (int through = 4; through <= most; through *= 2) run<2>(wall, method, through, clouds, ratio, growth);
      for (int through = 4; through <= most_solid; through *= 2) run<3>(wall, method, through, clouds, ratio, growth);
    }
}
