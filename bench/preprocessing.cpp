// SPDX-License-Identifier: GPL-3.0-or-later
/// What building a basis costs: CPU seconds of both clouds, weights, basis and quadrature on one thread, against
/// assembling, analysing and factoring P1 elasticity on the same mesh; growth with the mesh; memory. Prints a Markdown
/// table.
///
///   bench_preprocessing [largest number of triangles = 1e6] [repetitions = 5]
#include "efree/core/parallel.hpp"
#include "efree/geometry/planar_domain.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <malloc.h>
#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>

using namespace efree;

namespace {

double cpu_seconds() {
  return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

/// Resident memory now [bytes].
double resident() {
  long pages = 0, total = 0;
  std::ifstream("/proc/self/statm") >> total >> pages;
  return static_cast<double>(pages) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

template <class F> double median_cpu(int repetitions, const F& run) {
  std::vector<double> seconds;
  for (int k = 0; k < repetitions; ++k) {
    const double start = cpu_seconds();
    run();
    seconds.push_back(cpu_seconds() - start);
  }
  std::nth_element(seconds.begin(), seconds.begin() + repetitions / 2, seconds.end());
  return seconds[repetitions / 2];
}

void measure(const char* name, const FineMesh<2>& mesh, const std::vector<DisplacementCondition<2>>& conditions,
             int repetitions) {
  const double area = mesh.volumes().sum();
  const double h =
      std::sqrt(area / mesh.num_cells() * 4.0 / std::sqrt(3.0));  // edge of the equilateral triangle of mean area
  const ApproximationOptions options{.spacing = 16.0 * h};
  StageTimes stages;
  Index nodes = 0, points = 0;
  malloc_trim(0);
  const double before = resident();
  double memory = 0.0;
  const double ours = median_cpu(repetitions, [&] {
    StageTimes times;
    const auto approximation = approximate(mesh, options, &times);
    stages = times;
    nodes = approximation.shape.num_nodes();
    points = approximation.quadrature.size();
    memory = resident() - before;
  });
  const ElasticModel model{.material = {1.0, 0.3}, .essential = Essential::strong};
  const double p1 = median_cpu(repetitions, [&] {
    const auto elements = approximate(mesh, {.kind = BasisKind::p1});
    ElasticSolver<2>(elements, model, conditions);
  });
  std::printf("| %s | %d | %d | %d | %.3f | %.3f | %.3f | %.3f | **%.3f** | %.3f | %.2f | %.0f |\n", name,
              mesh.num_cells(), nodes, points, stages["cloud"], stages["weights"], stages["basis"],
              stages["quadrature"], ours, p1, ours / p1, memory / mesh.num_vertices());
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const double largest = argc > 1 ? std::atof(argv[1]) : 1e6;
  const int repetitions = argc > 2 ? std::atoi(argv[2]) : 5;
  set_num_threads(1);
  const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
  std::printf(
      "One thread, H/h = 16, defaults, median of %d. Stages are wall seconds of the last run, totals CPU seconds.\n\n",
      repetitions);
  std::printf(
      "| domain | triangles | nodes | points | clouds | weights | basis | quadrature | total [s] | P1: assemble, "
      "analyse, factor [s] | ratio | bytes per fine vertex |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (double triangles = 1e4; triangles <= 1.01 * largest; triangles *= std::sqrt(10.0)) {
    const double plate_size = std::sqrt((16.0 - 0.7854) * 3.6 / triangles);
    measure("plate with a hole",
            triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, plate_size), {.size = plate_size}),
            {{"left", {zero, nullptr}, nullptr}, {"bottom", {nullptr, zero}, nullptr}}, repetitions);
    const double holes_size = std::sqrt(73.0 * 3.6 / triangles);
    measure(
        "plate with 160 holes",
        triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, holes_size), {.size = holes_size}),
        {clamp<2>("left")}, repetitions);
  }
}
