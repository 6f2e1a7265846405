// SPDX-License-Identifier: GPL-3.0-or-later
/// What each choice of the method does to error and time on the plate with a hole: one choice at a time, all others at
/// their defaults. Writes CSV to standard output; seconds are CPU seconds on one thread, those of basis and solution
/// (without recovery and errors) and those of the fine mesh.
///
///   bench_choices [spacing... = 0.4 0.2 0.1]
#include "clock.hpp"
#include "efree/bench/kirsch.hpp"
#include "efree/core/parallel.hpp"

#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>

using namespace efree;
using efree::bench::cpu_seconds;

namespace {

constexpr int seeds = 3;

struct Setting {
  std::string choice, value;
  ApproximationOptions options{};
  Essential essential = Essential::nitsche;
  double mesh_ratio = 3.0;  ///< H/h
};

std::string text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%g", value);
  return buffer;
}

std::vector<Setting> settings() {
  std::vector<Setting> list;
  for (const double support : {1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.5})
    list.push_back({"support", text(support), {.support = support}});
  for (const auto& [kernel, name] : {std::pair{Kernel::cubic_spline, "cubic_spline"},
                                     {Kernel::quintic_spline, "quintic_spline"},
                                     {Kernel::wendland_c2, "wendland_c2"}})
    list.push_back({"kernel", name, {.kernel = kernel}});
  for (const auto& [secondary, name] :
       {std::pair{SecondaryKind::cells, "ratio_cells"}, {SecondaryKind::mls, "ratio_mls"}})
    for (const double ratio : {1.0, 1.4, 2.0, 3.0, 4.0, 6.0, 8.0})
      list.push_back({name, text(ratio), {.secondary = secondary, .ratio = ratio}});
  list.push_back({"ratio_full", "full", {.secondary = SecondaryKind::full}});
  for (const double mesh_ratio : {2.0, 3.0, 4.0, 6.0, 8.0, 12.0})
    for (const auto& [degree, name] : {std::pair{2, "mesh_ratio"}, {1, "mesh_ratio_linear"}})
      list.push_back({name, text(mesh_ratio), {.interpolation = degree}, Essential::nitsche, mesh_ratio});
  for (const auto& [weight, name] : {std::pair{Weight::visibility, "visibility"},
                                     {Weight::fast_marching, "fast_marching"},
                                     {Weight::heat_geodesic, "heat_geodesic"},
                                     {Weight::heat_flow, "heat_flow"},
                                     {Weight::euclidean, "euclidean"}})
    list.push_back({"weight", name, {.weight = weight}});
  for (const int order : {1, 2}) list.push_back({"order", text(order), {.order = order}});
  list.push_back({"essential", "nitsche"});
  list.push_back({"essential", "strong", {.vanish_on = bench::Kirsch::held()}, Essential::strong});
  return list;
}

struct TimedMesh {
  FineMesh<2> mesh;
  double seconds;
};
/// Meshed once for each size.
const TimedMesh& mesh_of(double size) {
  static std::map<double, TimedMesh> meshes;
  const auto found = meshes.find(size);
  if (found != meshes.end()) return found->second;
  const double start = cpu_seconds();
  auto mesh = bench::Kirsch::mesh(size);
  return meshes.emplace(size, TimedMesh{std::move(mesh), cpu_seconds() - start}).first->second;
}

void run(const Setting& setting, double spacing, int seed) {
  const TimedMesh& fine = mesh_of(spacing / setting.mesh_ratio);
  ApproximationOptions options = setting.options;
  options.spacing = spacing;
  options.seed = static_cast<std::uint64_t>(seed);
  const double start = cpu_seconds();
  const auto approximation = approximate(fine.mesh, options);
  const auto solution = bench::Kirsch::solver(approximation, setting.essential).solve(bench::Kirsch::loads());
  const double seconds = cpu_seconds() - start;
  const Errors errors = bench::Kirsch::errors(approximation, solution);
  std::printf("%s,%s,%g,%d,%d,%d,%.5e,%.5e,%.5e,%.4f,%.4f\n", setting.choice.c_str(), setting.value.c_str(), spacing,
              seed, approximation.shape.num_nodes(), approximation.quadrature.size(), *errors.l2_displacement,
              *errors.energy_norm, *errors.energy_norm_recovered, seconds, fine.seconds);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<double> spacings;
  for (int k = 1; k < argc; ++k) spacings.push_back(std::atof(argv[k]));
  if (spacings.empty()) spacings = {0.4, 0.2, 0.1};
  set_num_threads(1);
  std::printf("choice,value,H,seed,nodes,points,l2,energy,recovered,cpu_seconds,mesh_seconds\n");
  for (const double spacing : spacings)
    for (const Setting& setting : settings())
      for (int seed = 1; seed <= seeds; ++seed) run(setting, spacing, seed);
}
