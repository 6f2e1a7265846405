// SPDX-License-Identifier: GPL-3.0-or-later
/// Thick cylinder and sphere under internal pressure: sections and solids against Lame's closed form, errors at the
/// inner wall and over the body, by nodes through the wall: the largest of three clouds. Seconds are those of one run,
/// without the mesh and the recovery. Writes a table (Markdown) to standard output.
///
///   bench_lame [most nodes through the wall = 8] [most for solids = 8] [H/h of solids = 2.5] [order = 1]
///              [interpolation = 0: default] [points per node = 0: default]
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
  std::array<double, 7> largest{};
  double seconds = 0.0;
  Index nodes = 0;
  const int clouds = elements ? 1 : 3;
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
  const double ratio = argc > 3 ? std::atof(argv[3]) : 2.5;
  const ApproximationOptions options{.order = argc > 4 ? std::atoi(argv[4]) : 1,
                                     .interpolation = argc > 5 ? std::atoi(argv[5]) : 0,
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
