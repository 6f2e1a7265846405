// SPDX-License-Identifier: GPL-3.0-or-later
/// A 10 x 10 plate with 160 random holes (radii 0.04 to 0.4, gaps at least 0.03) in tension: strain energy with all
/// defaults against P1 finite elements on the same fine mesh. Prints a Markdown table.
///
///   bench_random_holes [spacing = 0.2] [fine mesh size = 0.05] [seeds = 3]
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;

namespace {

struct Result {
  double energy, seconds;
  Index nodes, points, grown, dropped;
  double largest_sum;
};

Result solve(const FineMesh<2>& mesh, const ApproximationOptions& options) {
  StageTimes times;
  const Monitor monitor{.times = &times};
  const auto approximation = approximate(mesh, options, monitor);
  const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
  const Essential essential = options.kind == BasisKind::mls ? Essential::nitsche : Essential::strong;
  const ElasticSolver<2> solver(approximation,
                                {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential},
                                {{"left", {zero, nullptr}, nullptr}, {"bottom", {nullptr, zero}, nullptr}}, monitor);
  const auto solution = solver.solve({{{"right",
                                        [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                                          return {1.0, 0.0};
                                        }}},
                                      nullptr});
  return {solution.strain_energy,           times.total(),
          approximation.shape.num_nodes(),  approximation.quadrature.size(),
          approximation.mls.grown_vertices, approximation.dropped_points,
          approximation.mls.largest_sum};
}

}  // namespace

int main(int argc, char** argv) {
  const double spacing = argc > 1 ? std::atof(argv[1]) : 0.2, size = argc > 2 ? std::atof(argv[2]) : 0.05;
  const int seeds = argc > 3 ? std::atoi(argv[3]) : 3;
  std::printf(
      "Strain energy under tension against P1 on the fine mesh (positive: softer). H = %g, h <= %g, defaults.\n\n",
      spacing, size);
  std::printf(
      "| plate | secondary basis | M/N asked | fine vertices | nodes | fewer unknowns | points | energy / fine P1 - 1 "
      "| grown vertices | largest sum of abs. values | dropped points | seconds (P1) |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (int seed = 1; seed <= seeds; ++seed) {
    const auto mesh =
        triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, static_cast<std::uint64_t>(seed), size),
                    {.size = size});
    const Result p1 = solve(mesh, {.kind = BasisKind::p1});
    struct Variant {
      const char* name;
      SecondaryKind secondary;
      double ratio;
    };
    for (const Variant& variant :
         {Variant{"cells (default)", SecondaryKind::cells, 0.0}, Variant{"cells", SecondaryKind::cells, 1.0},
          Variant{"cells", SecondaryKind::cells, 4.0}, Variant{"mls", SecondaryKind::mls, 0.0},
          Variant{"full", SecondaryKind::full, 0.0}}) {
      const Result r = solve(mesh, {.spacing = spacing,
                                    .seed = static_cast<std::uint64_t>(seed),
                                    .secondary = variant.secondary,
                                    .ratio = variant.ratio});
      std::printf("| %d | %s | %g | %d | %d | %.1f x | %d | %+.2f %% | %d | %.1f | %d | %.2f (%.2f) |\n", seed,
                  variant.name, variant.ratio, mesh.num_vertices(), r.nodes,
                  static_cast<double>(mesh.num_vertices()) / r.nodes, r.points, 100.0 * (r.energy / p1.energy - 1.0),
                  r.grown, r.largest_sum, r.dropped, r.seconds, p1.seconds);
      std::fflush(stdout);
    }
  }
}
