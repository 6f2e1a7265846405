// SPDX-License-Identifier: GPL-3.0-or-later
/// From an image to its effective modulus, on cells or by corrected clouds on lattice meshes: error against time and
/// memory, to be read beside the tables of bench/peers (same problems, same references).
///
///   bench_image_front cells [block | gyroid | gyroid_labels] [size in voxels = 2] [tolerance = 5e-4] [threads = 1]
///     [nu = 0.3; references are for 0.3]
///   bench_image_front anisotropy [block | gyroid | gyroid_labels] [size in voxels = 2] [threads = 1]
///   bench_image_front [block | gyroid] [size in voxels = 2] [degree of the cells = 1] [tolerance = 0.01] [spacing in
///   voxels = default]
#include "clock.hpp"
#include "gyroid.hpp"

#include "efree/core/parallel.hpp"
#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/correction.hpp"
#include "efree/solvers/cells/cell_solver.hpp"

#include <sys/resource.h>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <string>

using namespace efree;
using efree::bench::cpu_seconds;

namespace {

double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

struct Body {
  LabelImage<3> image;
  double reference;
};
Body body_named(const std::string& name) {
  if (name == "block") return {random_spheres<3>(128, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0}), 0.4653};
  return {name == "gyroid_labels" ? bench::gyroid_labels(96) : bench::gyroid_sheet(96), 0.0868};
}

std::vector<DisplacementCondition<3>> pulled(double shift) {
  return {symmetry_plane<3>("left"),
          symmetry_plane<3>("front"),
          symmetry_plane<3>("bottom"),
          {"top", {}, [=](const Vec<3>&) { return shift; }}};
}

int on_cells(const std::string& name, double size, double tolerance, int threads, double nu) {
  const Body body = body_named(name);
  set_num_threads(threads);
  const double start = cpu_seconds(), wall = bench::wall_seconds();
  const LabelImage<3> image = keep_largest(body.image).image;
  const double kept = cpu_seconds();
  const double edge = image.size[0];
  StageTimes times;
  const CellSolution solution = solve_on_cells(image, {{}, LinearElastic(1.0, nu)}, pulled(0.01 * edge), {},
                                               {.size = size, .tolerance = tolerance}, {.times = &times});
  const double all = cpu_seconds() - start, passed = bench::wall_seconds() - wall;
  const auto modulus = [&](double energy) { return 2.0 * energy / (1e-4 * edge * edge * edge); };
  for (const CellLevel& level : solution.levels)
    std::printf("| %s | %.3g | %d | %.5f | %+.2f %% | %d | %.1e |\n", name.c_str(), level.edges[0], level.cells,
                modulus(level.strain_energy), 100.0 * (modulus(level.strain_energy) / body.reference - 1.0),
                level.iterations, level.iteration_error);
  std::printf(
      "extrapolated %.5f (%+.2f %%), error in the energy norm %.3f (true %.3f); islands %.2f s, set-up %.2f s, solve "
      "%.2f s, all %.2f s of CPU, %.2f s of "
      "clock, %.0f MiB\n",
      modulus(solution.extrapolated_energy), 100.0 * (modulus(solution.extrapolated_energy) / body.reference - 1.0),
      solution.grid_error, std::sqrt(std::abs(1.0 - body.reference / modulus(solution.finest().strain_energy))),
      kept - start, times["assembly"], times["solve"], all, passed, peak_mib());
  return 0;
}

/// Iterations by how much stiffer a transversely isotropic material is along its axis than across, which is along x or
/// oblique.
int by_anisotropy(const std::string& name, double size, int threads) {
  const LabelImage<3> image = keep_largest(body_named(name).image).image;
  set_num_threads(threads);
  std::printf("| E1 / E3 | axes | iterations on the finest grid, the second, the third | solve [s] | energy |\n");
  for (const double ratio : {1.0, 2.0, 5.0, 10.0, 20.0, 50.0})
    for (const bool oblique : {false, true}) {
      Mat<3> axes = Mat<3>::Identity();
      if (oblique) axes = Eigen::AngleAxisd(0.7, Vec<3>(1.0, 2.0, 3.0).normalized()).toRotationMatrix();
      const double shear = 0.4 * std::sqrt(ratio);
      const OrthotropicElastic material({{ratio, 1.0, 1.0}, Vec<3>::Constant(0.25), {0.4, shear, shear}, axes});
      StageTimes times;
      const CellSolution solution =
          solve_on_cells(image, {{}, material}, pulled(0.01 * image.size[2]), {}, {.size = size}, {.times = &times});
      std::printf("| %g | %s | %d, %d, %d | %.2f | %.5g |\n", ratio, oblique ? "oblique" : "along x",
                  solution.levels[0].iterations, solution.levels[1].iterations, solution.levels[2].iterations,
                  times["solve"], solution.finest().strain_energy);
    }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "anisotropy")
    return by_anisotropy(argc > 2 ? argv[2] : "block", argc > 3 ? std::atof(argv[3]) : 2.0,
                         argc > 4 ? std::atoi(argv[4]) : 1);
  if (argc > 1 && std::string(argv[1]) == "cells")
    return on_cells(argc > 2 ? argv[2] : "block", argc > 3 ? std::atof(argv[3]) : 2.0,
                    argc > 4 ? std::atof(argv[4]) : 5e-4, argc > 5 ? std::atoi(argv[5]) : 1,
                    argc > 6 ? std::atof(argv[6]) : 0.3);
  const std::string name = argc > 1 ? argv[1] : "block";
  const double size = argc > 2 ? std::atof(argv[2]) : 2.0;
  const int degree = argc > 3 ? std::atoi(argv[3]) : 1;
  const double tolerance = argc > 4 ? std::atof(argv[4]) : 0.01;
  const Index voxels = name == "block" ? 128 : 96;
  auto [image, reference] = body_named(name);
  const double start = cpu_seconds();
  image = keep_largest(image).image;
  double before = start;
  const auto lap = [&] {
    const double now = cpu_seconds(), passed = now - before;
    before = now;
    return passed;
  };
  FineMesh<3> mesh(keep_largest(mesh_image<3>(image, {.size = size})).mesh);
  const double meshing = lap();
  auto cloud = approximate<3>(mesh, {.spacing = argc > 5 ? std::atof(argv[5]) : 0.0});
  const double basis = lap();
  const ElasticModel model{.material = LinearElastic(1.0, 0.3)};
  const std::vector<DisplacementCondition<3>> supports = pulled(0.01 * voxels);
  const auto solution = ElasticSolver<3>(cloud, model, supports).solve({});
  const double solving = lap();
  Points<3> from = interpolate(cloud.shape, solution.coefficients);
  if (degree == 2) {
    cloud = in_quadratic_space(cloud);
    from = interpolate(cloud.shape, solution.coefficients);
  }
  const Corrector<3> corrector(cloud, model, supports);
  const double set_up = lap();
  const auto correction = corrector.correct(from, {}, {.tolerance = tolerance});
  const double iterating = lap();
  const double all = cpu_seconds() - start;
  const auto modulus = [&](double energy) { return 2.0 * energy / (1e-4 * std::pow(voxels, 3)); };
  const double value = modulus(correction.strain_energy);
  std::printf(
      "| %s | %g | P%d | %d | %d | %td | %.5f | %+.2f %% | %.5f | %.3f | %.4f | %d | %.2f | %.2f | %.2f | %.2f | %.2f "
      "| %.1f | %.0f |\n",
      name.c_str(), size, degree, mesh.num_cells(), 3 * cloud.space.size(), cloud.nodes.cols(), value,
      100.0 * (value / reference - 1.0), modulus(solution.strain_energy), correction.start_error, correction.error,
      correction.iterations, meshing, basis, solving, set_up, iterating, all, peak_mib());
}
