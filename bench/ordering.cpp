// SPDX-License-Identifier: GPL-3.0-or-later
/// What factors of quadratic elements cost, their nodes ordered by the vertices that they follow, against CHOLMOD's own
/// strategy on all unknowns. CPU seconds on one thread, medians; runs of both alternate. Prints a Markdown table.
///
///   bench_ordering [runs = 3] [size = 1: factor on the mesh sizes]
#include "clock.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/equations/equilibrium.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace efree;
using efree::bench::median;
using efree::bench::seconds;

namespace {

struct Cost {
  std::vector<double> analysis, factor;
  double operations = 0.0;

  void measure(const SymmetricMatrix& K, const std::vector<Index>& node_of) {
    Cholesky solver;
    const double start = seconds();
    solver.analyse(K, node_of);
    const double analysed = seconds();
    solver.factorize_definite(K);
    analysis.push_back(analysed - start);
    factor.push_back(seconds() - analysed);
    operations = solver.operations();
  }
};

template <int Dim> void measure(const char* body, const FineMesh<Dim>& mesh, int runs) {
  const auto elements = approximate(mesh, {.kind = BasisKind::p2});
  DisplacementCondition<Dim> held{.on = "left", .components = {}, .normal = {}};
  held.components.fill([](const Vec<Dim>&) { return 0.0; });
  const Equilibrium<Dim> equations(elements, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}, {held});
  SymmetricMatrix K = equations.tangent_pattern();
  equations.tangent(equations.rest(), K);
  Cost by_vertices, by_unknowns;
  for (int run = 0; run < runs; ++run) {
    by_vertices.measure(K, equations.node_of_unknowns());
    by_unknowns.measure(K, {});
  }
  std::printf("| %s, %d cells, %d unknowns | %.2f, %.2f | %.2f, %.2f | %.2g, %.2g | %.2f |\n", body, mesh.num_cells(),
              static_cast<int>(K.cols()), median(by_unknowns.analysis), median(by_vertices.analysis),
              median(by_unknowns.factor), median(by_vertices.factor), by_unknowns.operations, by_vertices.operations,
              (median(by_vertices.analysis) + median(by_vertices.factor)) /
                  (median(by_unknowns.analysis) + median(by_unknowns.factor)));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int runs = argc > 1 ? std::atoi(argv[1]) : 3;
  const double size = argc > 2 ? std::atof(argv[2]) : 1.0;
  set_num_threads(1);
  std::printf(
      "| body | analysis [s]: unknowns, vertices | factor [s] | operations | ratio of times "
      "|\n|---|---|---|---|---|\n");
  measure<2>(
      "plate with 160 holes",
      triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, 0.05 * size), {.size = 0.05 * size}),
      runs);
  measure<2>("rectangle 4 x 1", triangulate(shapes::rectangle(0.0, 0.0, 4.0, 1.0), {.size = 0.01 * size}), runs);
  measure<3>("box 2 x 1 x 1", FineMesh<3>(solids::box({2.0, 1.0, 1.0}, 0.2 * size)), runs);
  measure<3>("bar 8 x 1 x 1", FineMesh<3>(solids::box({8.0, 1.0, 1.0}, 0.2 * size)), runs);
}
