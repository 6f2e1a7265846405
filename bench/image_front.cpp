// SPDX-License-Identifier: GPL-3.0-or-later
/// From an image to its effective modulus by corrected clouds on lattice meshes: error against time and memory, to be
/// read beside the tables of bench/peers (same problems, same references).
///
///   bench_image_front [block | gyroid] [size in voxels = 2] [degree of the cells = 1] [tolerance = 0.01] [spacing in
///   voxels = default]
#include "efree/geometry/image_mesh.hpp"
#include "efree/geometry/label_image.hpp"
#include "efree/geometry/largest_body.hpp"
#include "efree/solvers/correction.hpp"

#include <sys/resource.h>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numbers>
#include <string>

using namespace efree;

namespace {

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}
double peak_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

/// The sheet abs(sin X cos Y + sin Y cos Z + sin Z cos X) < 0.4, X = 2 pi x / 32, sampled at the middles of voxels.
LabelImage<3> gyroid() {
  LabelImage<3> image;
  image.size = {96, 96, 96};
  const auto at = [](Index i) { return 2.0 * std::numbers::pi * (i + 0.5) / 32.0; };
  for (Index k = 0; k < 96; ++k)
    for (Index j = 0; j < 96; ++j)
      for (Index i = 0; i < 96; ++i) {
        const double X = at(i), Y = at(j), Z = at(k);
        const double value =
            0.4 - std::abs(std::sin(X) * std::cos(Y) + std::sin(Y) * std::cos(Z) + std::sin(Z) * std::cos(X));
        image.labels.push_back(value > 0.0);
        image.grey.push_back(static_cast<float>(value));
      }
  return image;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = argc > 1 ? argv[1] : "block";
  const double size = argc > 2 ? std::atof(argv[2]) : 2.0;
  const int degree = argc > 3 ? std::atoi(argv[3]) : 1;
  const double tolerance = argc > 4 ? std::atof(argv[4]) : 0.01;
  const Index voxels = name == "block" ? 128 : 96;
  const double reference = name == "block" ? 0.4653 : 0.0868;
  auto image = name == "block" ? random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0}) : gyroid();
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
  const ElasticModel model{.material = {1.0, 0.3}};
  const std::vector<DisplacementCondition<3>> supports{symmetry_plane<3>("left"),
                                                       symmetry_plane<3>("front"),
                                                       symmetry_plane<3>("bottom"),
                                                       {"top", {}, [=](const Vec<3>&) { return 0.01 * voxels; }}};
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
