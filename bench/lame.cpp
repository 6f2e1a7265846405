// SPDX-License-Identifier: GPL-3.0-or-later
/// Thick cylinder and sphere under internal pressure: sections and solids against Lame's closed form, errors at the
/// inner wall and over the body, by nodes through the wall. Writes a table (Markdown) to standard output.
///
///   bench_lame [most nodes through the wall = 8] [most for solids = 8] [H/h of solids = 2.5] [order = 1]
///              [interpolation = 1] [points per node = 4 cells, 6 MLS functions]
#include "efree/bench/lame.hpp"

#include <cstdio>
#include <cstdlib>
#include <ctime>

using namespace efree;
using bench::ThickWall;

namespace {

struct Method {
  const char* name;
  BasisKind kind;
  SecondaryKind secondary;
};
constexpr Method methods[] = {{"cells", BasisKind::mls, SecondaryKind::cells},
                              {"MLS", BasisKind::mls, SecondaryKind::mls},
                              {"P1", BasisKind::p1, SecondaryKind::full},
                              {"P2", BasisKind::p2, SecondaryKind::full}};

template <int Dim>
void run(const ThickWall& wall, const Method& method, int through, double ratio, ApproximationOptions options) {
  const double H = (ThickWall::outer - ThickWall::inner) / (through - 1);
  const bool elements = method.kind != BasisKind::mls;
  // Elements with as many nodes through the wall: P2 has one at the middle of every edge.
  const double size = method.kind == BasisKind::p1 ? 1.2 * H : method.kind == BasisKind::p2 ? 2.4 * H : H / ratio;
  const std::clock_t start = std::clock();
  const auto mesh = [&] {
    if constexpr (Dim == 2)
      return triangulate(wall.section(4.0 * H, size), {.size = size});
    else
      return FineMesh<3>(wall.solid(2.0 * H, size));
  }();
  options.kind = method.kind;
  options.axisymmetric = Dim == 2;
  options.spacing = H;
  options.secondary = method.secondary;
  const auto approximation = approximate(mesh, options);
  // The symmetry planes of the sphere are flat, so that elements can hold them at their nodes.
  const auto solver = wall.solver<Dim>(approximation, elements ? Essential::strong : Essential::nitsche);
  const Solution<Dim> solution = solver.solve(wall.loads<Dim>());
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  const auto errors = wall.errors<Dim>(approximation, solution);
  std::printf("| %s | %s | %s | %d | %td | %d | %.2f %% | %.2f %% | %.2f %% | %.2f %% | %.1e | %.1e | %.1e | %.2f |\n",
              wall.sphere ? "sphere" : "cylinder", Dim == 2 ? "axisymmetric" : "3D", method.name, through,
              approximation.nodes.cols(), mesh.num_cells(), 100.0 * errors.displacement.mean,
              100.0 * errors.displacement.worst, 100.0 * errors.hoop.mean, 100.0 * errors.hoop.worst,
              *errors.body.l2_displacement, *errors.body.energy_norm, *errors.body.energy_norm_recovered, seconds);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int most = argc > 1 ? std::atoi(argv[1]) : 8;
  const int most_solid = argc > 2 ? std::atoi(argv[2]) : 8;
  const double ratio = argc > 3 ? std::atof(argv[3]) : 2.5;
  const ApproximationOptions options{.order = argc > 4 ? std::atoi(argv[4]) : 1,
                                     .interpolation = argc > 5 ? std::atoi(argv[5]) : 1,
                                     .ratio = argc > 6 ? std::atof(argv[6]) : 0.0};
  std::printf(
      "| body | analysis | method | nodes through the wall | nodes | fine cells | displacement at the "
      "inner wall, mean | worst | hoop stress there, mean | worst | displacement, L2 | energy norm | recovered | CPU s "
      "|\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const bool sphere : {false, true})
    for (const Method& method : methods) {
      const ThickWall wall{sphere};
      for (int through = 4; through <= most; through *= 2) run<2>(wall, method, through, 4.0, options);
      for (int through = 4; through <= most_solid; through *= 2) run<3>(wall, method, through, ratio, options);
    }
}
