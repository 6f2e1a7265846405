// SPDX-License-Identifier: GPL-3.0-or-later
/// What building a basis costs: CPU seconds of both clouds, weights, basis and quadrature on one thread, against
/// assembling, analysing and factoring P1 elasticity on the same mesh; growth with the mesh; memory. Prints a Markdown
/// table.
///
///   bench_preprocessing [largest number of triangles = 1e6] [repetitions = 5]
///   bench_preprocessing --solid [largest number of tetrahedra = 1e6] [repetitions = 3]
#include "clock.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <malloc.h>
#include <unistd.h>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <string_view>

using namespace efree;
using efree::bench::median_cpu;

namespace {

/// Resident memory now [bytes].
double resident() {
  long pages = 0, total = 0;
  std::ifstream("/proc/self/statm") >> total >> pages;
  return static_cast<double>(pages) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// `per_spacing`: H over the edge of the regular triangle or tetrahedron of mean measure.
template <int Dim> void measure(const char* name, const FineMesh<Dim>& mesh, double per_spacing,
                                const std::vector<DisplacementCondition<Dim>>& conditions, int repetitions) {
  const double mean = mesh.volumes().sum() / mesh.num_cells();
  const double h = Dim == 2 ? std::sqrt(mean * 4.0 / std::sqrt(3.0)) : std::cbrt(mean * 6.0 * std::sqrt(2.0));
  const ApproximationOptions options{.spacing = per_spacing * h};
  StageTimes stages;
  Index nodes = 0, points = 0;
  malloc_trim(0);
  const double before = resident();
  double memory = 0.0;
  const double ours = median_cpu(repetitions, [&] {
    StageTimes times;
    const auto approximation = approximate(mesh, options, {.times = &times});
    stages = times;
    nodes = approximation.shape.num_nodes();
    points = approximation.quadrature.size();
    memory = resident() - before;
  });
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = Essential::strong};
  const double p1 = median_cpu(repetitions, [&] {
    const auto elements = approximate(mesh, {.kind = BasisKind::p1});
    ElasticSolver<Dim>(elements, model, conditions);
  });
  std::printf("| %s | %d | %d | %d | %.3f | %.3f | %.3f | %.3f | **%.3f** | %.3f | %.2f | %.0f |\n", name,
              mesh.num_cells(), nodes, points, stages["cloud"], stages["weights"], stages["basis"],
              stages["quadrature"], ours, p1, ours / p1, memory / mesh.num_vertices());
  std::fflush(stdout);
}

void head(const char* cells, int repetitions, double per_spacing) {
  std::printf(
      "One thread, H/h = %g, defaults, median of %d. Stages are wall seconds of the last run, totals CPU seconds.\n\n",
      per_spacing, repetitions);
  std::printf(
      "| domain | %s | nodes | points | clouds | weights | basis | quadrature | total [s] | P1: assemble, "
      "analyse, factor [s] | ratio | bytes per fine vertex |\n",
      cells);
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  std::fflush(stdout);
}

void planar(double largest, int repetitions) {
  constexpr double per_spacing = 16.0;
  head("triangles", repetitions, per_spacing);
  const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
  for (double triangles = 1e4; triangles <= 1.01 * largest; triangles *= std::sqrt(10.0)) {
    const double plate_size = std::sqrt((16.0 - 0.7854) * 3.6 / triangles);
    measure<2>("plate with a hole",
               triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, plate_size), {.size = plate_size}), per_spacing,
               {{"left", {zero, nullptr}, nullptr}, {"bottom", {nullptr, zero}, nullptr}}, repetitions);
    const double holes_size = std::sqrt(73.0 * 3.6 / triangles);
    measure<2>(
        "plate with 160 holes",
        triangulate(shapes::plate_with_random_holes(10.0, 160, 0.04, 0.4, 0.03, 1, holes_size), {.size = holes_size}),
        per_spacing, {clamp<2>("left")}, repetitions);
  }
}

/// A block of ever more voxels and pores, and an eighth of a cube with a spherical cavity.
void solid(double largest, int repetitions) {
  constexpr double per_spacing = 5.0;
  head("tetrahedra", repetitions, per_spacing);
  for (double tetrahedra = 1e4; tetrahedra <= 1.01 * largest; tetrahedra *= std::sqrt(10.0)) {
    const double size = std::cbrt(7.5 * 48.0 / tetrahedra);
    measure<3>("spherical cavity", FineMesh<3>(solids::spherical_cavity(1.0, 2.0, size)), per_spacing,
               {clamp<3>("bottom")}, repetitions);
    const Index voxels = static_cast<Index>(std::lround(std::cbrt(tetrahedra * 2.7)));
    const auto image = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
    measure<3>("porous block", FineMesh<3>(mesh_image<3>(image, {.size = 3.0, .mesher = Mesher::delaunay})),
               per_spacing, {clamp<3>("bottom")}, repetitions);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool in_space = argc > 1 && std::string_view(argv[1]) == "--solid";
  if (in_space) --argc, ++argv;
  const double largest = argc > 1 ? std::atof(argv[1]) : 1e6;
  const int repetitions = argc > 2 ? std::atoi(argv[2]) : in_space ? 3 : 5;
  set_num_threads(1);
  if (in_space)
    solid(largest, repetitions);
  else
    planar(largest, repetitions);
}
