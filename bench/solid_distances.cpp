// SPDX-License-Identifier: GPL-3.0-or-later
/// What distances in space cost: CPU seconds on one thread for all nodes of a cloud, and for each pair of a node and a
/// vertex in its reach; with that, all of `approximate`. Medians. Prints a Markdown table.
///
///   bench_solid_distances [voxels a side of the porous block = 128] [repetitions = 5]
#include "clock.hpp"
#include "efree/bench/cavity.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/heatgeo/geodesics.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;
using efree::bench::median_cpu;

namespace {

void measure(const char* name, const FineMesh<3>& mesh, double spacing, int repetitions) {
  const auto cloud = sample_cloud<3>(mesh, CloudOptions{.spacing = spacing});
  const Vector radii = 2.5 * cloud.spacing;
  SparseRows table;
  const double distances =
      median_cpu(repetitions, [&] { table = node_distances(mesh, cloud.vertices, radii, Weight::automatic); });
  const Index pairs = static_cast<Index>(table.nonZeros());
  Index straight = 0;
  for (Index v = 0; v < table.rows(); ++v)
    for (SparseRows::InnerIterator entry(table, v); entry; ++entry)
      straight += entry.value() <= (mesh.vertex(v) - cloud.positions.col(entry.col())).norm() * (1.0 + 1e-12);
  const double all = median_cpu(repetitions, [&] { approximate(mesh, {.spacing = spacing}); });
  std::printf("| %s | %d | %g | %d | %d | %.2f | %.2f | %.2f | %.2f |\n", name, mesh.num_cells(), spacing, cloud.size(),
              pairs, static_cast<double>(straight) / pairs, distances, 1e6 * distances / pairs, all);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const Index voxels = argc > 1 ? std::atoi(argv[1]) : 128;
  const int repetitions = argc > 2 ? std::atoi(argv[2]) : 5;
  set_num_threads(1);
  std::printf(
      "| domain | tetrahedra | H | nodes | pairs | of them in sight | distances [s] | a pair [us] | approximate [s] |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
  {
    const auto image = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
    const FineMesh<3> mesh(mesh_image<3>(image, {.size = 3.0}));
    for (const double spacing : {5.5, 7.0, 10.0, 14.0}) measure("porous block", mesh, spacing, repetitions);
  }
  const FineMesh<3> cavity = bench::Cavity::mesh(0.09);
  for (const double spacing : {0.2, 0.4}) measure("spherical cavity", cavity, spacing, repetitions);
}
