// SPDX-License-Identifier: GPL-3.0-or-later
/// Google Benchmark of the kernels on the quarter plate with a hole, H/h = 8: from clouds to the factorisation.
/// Argument of each: fine cells in thousands, roughly.
#include "efree/assembly/operators.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>

using namespace efree;

namespace {

struct Plate {
  FineMesh<2> mesh;
  double spacing;
  Approximation<2> approximation;
};

/// Built once per size.
const Plate& plate(std::int64_t thousands) {
  static std::map<std::int64_t, Plate> known;
  const auto [entry, is_new] = known.try_emplace(thousands);
  Plate& plate = entry->second;
  if (is_new) {
    const double size = std::sqrt(15.2 * 3.6 / (1e3 * static_cast<double>(thousands)));
    plate.mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, size), {.size = size});
    plate.spacing = 8.0 * size;
    plate.approximation = approximate(plate.mesh, {.spacing = plate.spacing});
  }
  return plate;
}

void sampling(benchmark::State& state) {
  const Plate& p = plate(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(sample_cloud(p.mesh, CloudOptions{p.spacing, 1}));
}
void weights(benchmark::State& state, Weight engine) {
  const Plate& p = plate(state.range(0));
  const auto cloud = sample_cloud(p.mesh, CloudOptions{p.spacing, 1});
  const Vector radii = 2.5 * cloud.spacing;
  for (auto _ : state)
    benchmark::DoNotOptimize(node_weights(p.mesh, cloud.vertices, radii, {engine, Kernel::cubic_spline}));
}
void basis(benchmark::State& state) {
  const Plate& p = plate(state.range(0));
  const auto cloud = sample_cloud(p.mesh, CloudOptions{p.spacing, 1});
  for (auto _ : state) benchmark::DoNotOptimize(moving_least_squares(p.mesh, cloud, {.support = 2.5}));
}
void projection(benchmark::State& state) {
  const Plate& p = plate(state.range(0));
  const auto points = sample_cloud(p.mesh, CloudOptions{0.5 * p.spacing, 2});
  const auto secondary = cell_clusters(p.approximation.space, points);
  for (auto _ : state) benchmark::DoNotOptimize(project(p.approximation.space, p.approximation.shape, secondary));
}
void assembly(benchmark::State& state) {
  const Plate& p = plate(state.range(0));
  const auto C = Materials<2>({LinearElastic(1.0, 0.3)}, Plane::stress).tangents(p.approximation.quadrature);
  for (auto _ : state) benchmark::DoNotOptimize(stiffness_matrix(p.approximation.quadrature, C));
}
void factorisation(benchmark::State& state) {
  const Plate& p = plate(state.range(0));
  SymmetricMatrix K =
      stiffness_matrix(p.approximation.quadrature,
                       Materials<2>({LinearElastic(1.0, 0.3)}, Plane::stress).tangents(p.approximation.quadrature));
  for (Index i = 0; i < K.cols(); ++i) K.coeffRef(i, i) += 1.0;  // any support that makes it definite
  std::vector<Index> node_of;
  for (Index i = 0; i < K.cols(); ++i) node_of.push_back(i / 2);
  for (auto _ : state) benchmark::DoNotOptimize(Cholesky(K, node_of));
}

BENCHMARK(sampling)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(weights, visibility, Weight::visibility)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(weights, fast_marching, Weight::fast_marching)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(weights, heat_geodesic, Weight::heat_geodesic)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK(basis)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK(projection)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK(assembly)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);
BENCHMARK(factorisation)->Arg(10)->Arg(100)->Unit(benchmark::kMillisecond);

}  // namespace

int main(int argc, char** argv) {
  set_num_threads(1);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
}
