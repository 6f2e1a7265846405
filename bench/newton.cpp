// SPDX-License-Identifier: GPL-3.0-or-later
// What an iteration of Newton's method costs on a cloud and on linear elements of the same fine mesh: tangent, factor,
// solve and residual of a neo-Hookean plate with a hole (or a block), and what scales with threads.
//
//   bench_newton [2|3] [cells] [nodes] [repetitions]
//
// A line for each: unknowns, points, milliseconds (medians) of the parts; last the ratio of the whole.
#include "clock.hpp"

#include <efree/efree.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

using namespace efree;
using efree::bench::median;

namespace {

template <int Dim> std::vector<DisplacementCondition<Dim>> pulled() {
  std::vector<DisplacementCondition<Dim>> conditions{
      symmetry_plane<Dim>("left"), symmetry_plane<Dim>("bottom"), {"right", {}, [](const Vec<Dim>&) { return 0.3; }}};
  if (Dim == 3) conditions.push_back(symmetry_plane<Dim>("front"));
  return conditions;
}

/// Milliseconds of one iteration in all.
template <class Linear, int Dim> double iteration(const std::string& name, const Approximation<Dim>& approximation,
                                                  Essential essential, int repetitions) {
  const NonlinearEquilibrium<Dim> equations(
      approximation, {.material = NeoHookean({.E = 1.0, .nu = 0.3}), .plane = Plane::strain, .essential = essential},
      Program<Dim>::grows(pulled<Dim>()));
  Linear linear;
  TangentSolver solver(equations, linear);
  const State state = newton(equations, solver, equations.rest(), 0.3).state;
  SymmetricMatrix K;
  equations.tangent(state, K);
  linear.analyse(K, equations.node_of_unknowns());
  std::map<std::string, std::vector<double>> times;
  for (int k = 0; k < repetitions; ++k) {
    const auto timed = [&](const char* part, const auto& work) {
      const double start = bench::seconds();
      work();
      times[part].push_back(1e3 * (bench::seconds() - start));
    };
    Vector r;
    timed("residual", [&] { r = equations.residual(state); });
    timed("tangent", [&] { equations.tangent(state, K); });
    timed("factor", [&] { linear.factorize(K); });
    timed("solve", [&] { linear.solve(-r); });
  }
  double all = 0.0;
  std::string parts;
  for (const char* part : {"residual", "tangent", "factor", "solve"}) {
    all += median(times[part]);
    parts += fmt::format(" {:>10.2f}", median(times[part]));
  }
  fmt::print("{:<18} {:>9} {:>9} {} {:>10.2f}\n", name, equations.node_of_unknowns().size(),
             approximation.quadrature.size(), parts, all);
  return all;
}

template <int Dim> void compare(const FineMesh<Dim>& mesh, double nodes, int repetitions) {
  double measure = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c) measure += mesh.volume(c);
  const double spacing = std::pow((Dim == 2 ? 1.15 : 1.4) * measure / nodes, 1.0 / Dim);
  fmt::print("{} cells, {} vertices, {} thread(s)\n{:<18} {:>9} {:>9} {:>11} {:>10} {:>10} {:>10} {:>10}\n",
             mesh.num_cells(), mesh.num_vertices(), num_threads(), "", "unknowns", "points", "residual", "tangent",
             "factor", "solve", "ms");
  const auto cloud = approximate<Dim>(mesh, {.spacing = spacing, .dilatation = Dilatation::pointwise});
  const auto elements = approximate<Dim>(mesh, {.kind = BasisKind::p1, .dilatation = Dilatation::pointwise});
  const int few = std::max(1, repetitions / 5);
  const std::string name = fmt::format("{} nodes", cloud.nodes.cols());
  const double of_cloud = iteration<HybridSolver, Dim>(name, cloud, Essential::nitsche, repetitions);
  iteration<Cholesky, Dim>(name + ", factor", cloud, Essential::nitsche, few);
  const double of_elements = iteration<Cholesky, Dim>("linear elements", elements, Essential::strong, few);
  fmt::print("an iteration on elements costs {:.1f} of those on the cloud\n", of_elements / of_cloud);
}

}  // namespace

int main(int argc, char** argv) {
  const int dim = argc > 1 ? std::atoi(argv[1]) : 2;
  const double cells = argc > 2 ? std::atof(argv[2]) : dim == 2 ? 1e5 : 5e5;
  const double nodes = argc > 3 ? std::atof(argv[3]) : dim == 2 ? 1000 : 4000;
  const int repetitions = argc > 4 ? std::atoi(argv[4]) : 11;
  if (dim == 2) {
    const double size = std::sqrt(3.5 * 15.2 / cells);
    compare<2>(triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, size), {.size = size}), nodes, repetitions);
  } else {
    compare<3>(FineMesh<3>(solids::box({1.0, 1.0, 1.0}, std::cbrt(50.0 / cells))), nodes, repetitions);
  }
}
