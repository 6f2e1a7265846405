// SPDX-License-Identifier: GPL-3.0-or-later
/// What further load cases cost: `efree solve` under one case and under ten, meshes included, without files and with
/// them (fields, pictures, result.json, in a folder for temporary files). CPU seconds on one thread, wall-clock seconds
/// on several. Medians; runs of both alternate. Prints a Markdown table, then by stage what a further case takes.
///
///   bench_load_cases [runs = 3] [size = 1: factor on the mesh sizes] [only: part of a name] [threads = 1]
#include "clock.hpp"
#include "efree/analysis/analyse.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/records/writers.hpp"
#include "efree/materials/linear_elastic.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>

using namespace efree;
using efree::bench::median;
using efree::bench::seconds;

namespace {

constexpr int many = 10;

/// Tractions on the right end, each in another direction, across it first, and one more on the top.
template <int Dim> std::vector<LoadCase<Dim>> load_cases(int count) {
  std::vector<LoadCase<Dim>> cases;
  for (int k = 0; k < count; ++k) {
    Vec<Dim> pull = Vec<Dim>::Zero();
    pull[0] = std::cos(0.6 * k + 1.5);
    pull[Dim - 1] = std::sin(0.6 * k + 1.5);
    LoadCase<Dim> one{.name = std::to_string(k), .loads = {}};
    one.loads.tractions = {
        {"right", [pull](const Vec<Dim>& x, const Vec<Dim>&) -> Vec<Dim> { return (1.0 + 0.1 * x[1]) * pull; }}};
    if (k % 2 == 1)
      one.loads.tractions.push_back(
          {"top", [k](const Vec<Dim>& x, const Vec<Dim>& n) -> Vec<Dim> { return -std::sin(k * x[0]) * n; }});
    cases.push_back(std::move(one));
  }
  return cases;
}

struct Method {
  const char* name;
  BasisKind kind;
  bool corrected;
};
constexpr Method methods[] = {{"P1", BasisKind::p1, false},
                              {"P2", BasisKind::p2, false},
                              {"cloud", BasisKind::mls, false},
                              {"corrected cloud", BasisKind::mls, true}};

std::filesystem::path folder() {
  return std::filesystem::temp_directory_path() / "efree_load_cases";
}

/// What `efree solve` writes.
template <int Dim> void write(const Settings<Dim>& settings, const Result<Dim>& result) {
  const auto folder = ::folder();
  std::filesystem::create_directories(folder);
  parallel_chunks(2, 1, [&](Index task, Index) {
    if (task == 0) {
      write_fields(folder / "fields.vtu", settings, result);
      write_nodes(folder / "nodes.vtu", result);
    } else {
      draw_result(folder / "fields.png", {.field = "von_mises"}, settings, result);
      draw_result(folder / "error.png", {.field = "error"}, settings, result);
    }
  });
  write_result(folder / "result.json", settings, result);
}

/// Of one case and of ten.
struct Times {
  std::vector<double> solving, all;
  std::map<std::string, std::vector<double>> stages;
};

template <int Dim>
void measure(const std::string& body, const MeshSource<Dim>& source, const Method& method, int runs) {
  Settings<Dim> settings;
  settings.common.model = {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  DisplacementCondition<Dim> held{.on = "left", .components = {}, .normal = {}};
  held.components.fill([](const Vec<Dim>&) { return 0.0; });
  settings.supports = {held};
  settings.common.approximation.kind = method.kind;
  settings.estimated = settings.corrected = method.corrected;
  Index cells = 0, degree = 1;
  Times one, ten;
  for (int run = 0; run < runs; ++run)
    for (const int count : {1, many}) {
      settings.cases = load_cases<Dim>(count);
      std::filesystem::remove_all(folder());
      Times& to = count == 1 ? one : ten;
      const double start = seconds();
      const Result<Dim> result = analyse(source, settings);
      to.solving.push_back(seconds() - start);
      write(settings, result);
      to.all.push_back(seconds() - start);
      to.stages["files"].push_back(to.all.back() - to.solving.back());
      for (const auto& [stage, spent] : result.times.stages()) to.stages[stage].push_back(spent);
      cells = result.mesh->num_cells();
      degree = result.basis().space.degree();
    }
  const double first = median(one.solving), all = median(ten.solving);
  std::printf("| %s, %d cells, %s%s | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f |", body.c_str(), cells, method.name,
              method.corrected && degree == 2 ? ", P2" : "", first, all, all / first, median(one.all), median(ten.all),
              median(ten.all) / median(one.all));
  for (const auto& [stage, spent] : ten.stages)
    if (const double more =
            (median(spent) - (one.stages.contains(stage) ? median(one.stages[stage]) : 0.0)) / (many - 1);
        more > 0.002)
      std::printf(" %s %.3f", stage.c_str(), more);
  std::printf(" |\n");
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const int runs = argc > 1 ? std::atoi(argv[1]) : 3;
  const double size = argc > 2 ? std::atof(argv[2]) : 1.0;
  const std::string only = argc > 3 ? argv[3] : "";
  keep_freed_memory();  // as the program does
  set_num_threads(argc > 4 ? std::atoi(argv[4]) : 1);
  std::printf(
      "| body | one | ten | ratio | one, files | ten, files | ratio | a further one, by stage [s] |\n"
      "|---|---|---|---|---|---|---|---|\n");
  const MeshSource<2> plate{
      .mesh =
          [](const MeshSize& wanted, const Stage&) {
            const auto domain = shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, wanted.length);
            return MadeMesh<2>{.mesh = triangulate_data(domain, {.size = wanted.length}), .size = wanted.length};
          },
      .size = 0.05 * size};
  const MeshSource<3> bar{
      .mesh =
          [](const MeshSize& wanted, const Stage&) {
            return MadeMesh<3>{.mesh = solids::box({8.0, 1.0, 1.0}, wanted.length), .size = wanted.length};
          },
      .size = 0.17 * size};
  for (const Method& method : methods) {
    const std::string name = method.name;
    if (("plane " + name).find(only) != std::string::npos) measure<2>("plate with 160 holes", plate, method, runs);
    if (("space " + name).find(only) != std::string::npos) measure<3>("bar", bar, method, runs);
  }
}
