// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective stiffness of plates full of holes against the truth (P2 on converged meshes): P1, P2, P2 with the smaller
/// holes dropped, and efree on uniform and graded clouds, all through the same code. Two kinds of plate:
///
///   holes   10 x 10, 160 holes of radius 0.04 to 0.4, gaps at least 0.03
///   porous  5 x 5, 500 holes of radius 0.02 to 0.1, gaps at least 0.01
///
/// Unit tension on the right edge, symmetry on the left and below; stiffness = tension^2 area / (2 strain energy).
/// Prints CSV. Times run from the outline to the solution: mesh, clouds, weights, basis, quadrature, assembly,
/// factorisation; wall-clock and CPU (all threads) seconds, the least of `repeats` runs.
///
///   bench_feature_rich [holes | porous = holes] [seeds = 3] [repeats = 3]
#include "efree/geometry/planar_domain.hpp"
#include "efree/solvers/static_analysis.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

using namespace efree;

namespace {

struct Kind {
  double width;
  int count;
  double r_min, r_max, gap;
  double unit;  ///< sizes below are in units of this
};

struct Mesh {
  double chord, size;  ///< of the sampled circles, of the triangles; in units
};

struct Result {
  double stiffness = 0.0, seconds = 1e30, cpu_seconds = 1e30;
  Index unknowns = 0, vertices = 0;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Without the holes of radius below `dropped`.
PlanarDomain plate(const Kind& kind, std::uint64_t seed, double chord, double dropped) {
  PlanarDomain domain =
      shapes::plate_with_random_holes(kind.width, kind.count, kind.r_min, kind.r_max, kind.gap, seed, chord);
  std::erase_if(domain.boundary, [&](const Polyline& line) {
    if (line.name != "holes") return false;
    double low = 1e30, high = -1e30;
    for (const Vec<2>& x : line.points) low = std::min(low, x.x()), high = std::max(high, x.x());
    return 0.5 * (high - low) < dropped;
  });
  return domain;
}

Result solve(const Kind& kind, std::uint64_t seed, const Mesh& sizes, double dropped,
             const ApproximationOptions& options, int repeats) {
  Result result;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    const PlanarDomain domain = plate(kind, seed, sizes.chord * kind.unit, dropped);
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t cpu_start = std::clock();
    const auto mesh = triangulate(domain, {.size = sizes.size * kind.unit});
    const auto approximation = approximate(mesh, options);
    const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
    const Essential essential = options.kind == BasisKind::mls ? Essential::nitsche : Essential::strong;
    const ElasticSolver<2> solver(approximation, {.material = {1.0, 0.3}, .essential = essential},
                                  {{"left", {zero, nullptr}, nullptr}, {"bottom", {nullptr, zero}, nullptr}});
    const auto solution = solver.solve({{{"right",
                                          [](const Vec<2>&, const Vec<2>&) -> Vec<2> {
                                            return {1.0, 0.0};
                                          }}},
                                        nullptr});
    result.seconds = std::min(result.seconds, seconds_since(start));
    result.cpu_seconds = std::min(result.cpu_seconds, static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC);
    result.stiffness = 0.5 * kind.width * kind.width / solution.strain_energy;
    result.unknowns = 2 * approximation.shape.num_nodes();
    result.vertices = mesh.num_vertices();
  }
  return result;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "holes";
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 3, repeats = argc > 3 ? std::atoi(argv[3]) : 3;
  if (name != "holes" && name != "porous") {
    std::fprintf(stderr, "bench_feature_rich: no plate '%s', expected holes or porous\n", name.c_str());
    return 2;
  }
  const bool holes = name == "holes";
  const Kind kind = holes ? Kind{10.0, 160, 0.04, 0.4, 0.03, 1.0} : Kind{5.0, 500, 0.02, 0.1, 0.01, 0.3};
  std::printf("plate,seed,method,chord,size,spacing,vertices,unknowns,fewer,seconds,cpu_seconds,stiffness,error\n");
  for (int s = 1; s <= seeds; ++s) {
    const auto seed = static_cast<std::uint64_t>(s);
    const ApproximationOptions quadratic{.kind = BasisKind::p2};
    const double truth = solve(kind, seed, {0.007, 0.07}, 0.0, quadratic, 1).stiffness;
    const auto report = [&](const char* method, const Mesh& sizes, double dropped,
                            const ApproximationOptions& options) {
      const Result r = solve(kind, seed, sizes, dropped, options, repeats);
      std::printf("%s,%d,%s,%g,%g,%g,%d,%d,%.2f,%.4f,%.4f,%.6f,%+.5f\n", name.c_str(), s, method,
                  sizes.chord * kind.unit, sizes.size * kind.unit, options.spacing, r.vertices, r.unknowns,
                  2.0 * r.vertices / r.unknowns, r.seconds, r.cpu_seconds, r.stiffness, r.stiffness / truth - 1.0);
      std::fflush(stdout);
    };
    report("truth check", {0.014, 0.1}, 0.0, quadratic);
    for (const double h : {0.4, 0.2, 0.1, 0.05}) report("P1", {h, h}, 0.0, {.kind = BasisKind::p1});
    const Mesh coarse[] = {{0.2, 0.4}, {0.1, 0.25}, {0.07, 0.25}, {0.05, 0.25}, {0.03, 0.2}};
    for (const Mesh& sizes : coarse) report("P2", sizes, 0.0, quadratic);
    for (const Mesh& sizes : coarse) {
      report("P2 without r < r_max/4", sizes, 0.25 * kind.r_max, quadratic);
      report("P2 without r < r_max/2", sizes, 0.5 * kind.r_max, quadratic);
    }
    // A fine mesh that resolves everything, and two about as coarse as the geometry allows.
    struct Family {
      std::string name;
      Mesh mesh;
      int degree;
    };
    for (const Family& family : {Family{"fine P1", {0.035, 0.035}, 1}, Family{"fine P2", {0.035, 0.035}, 2},
                                 Family{"coarse P1", {0.05, 0.1}, 1}, Family{"coarse P2", {0.05, 0.1}, 2},
                                 Family{"coarsest P2", {0.07, 0.15}, 2}}) {
      for (const double H : {0.3, 0.2, 0.15, 0.12})
        report(("uniform on " + family.name).c_str(), family.mesh, 0.0,
               {.interpolation = family.degree, .spacing = H * kind.unit});
      for (const double H : {0.6, 0.4, 0.3, 0.2, 0.15})
        report(("graded on " + family.name).c_str(), family.mesh, 0.0,
               {.interpolation = family.degree, .spacing = H * kind.unit, .grading = {.features = true}});
    }
  }
}
