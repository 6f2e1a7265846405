// SPDX-License-Identifier: GPL-3.0-or-later
/// What meshing images costs, and what it keeps: blocks with spherical pores, and a gyroid sheet with walls of about
/// four voxels. CPU seconds of all threads together, for the mesher and for FineMesh.
///
///   bench_image_mesh [voxels a side = 128] [cube of the lattice in voxels = 2.5] [lattice | delaunay]
///   bench_image_mesh gyroid
#include "clock.hpp"
#include "gyroid.hpp"

#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <string_view>
#include <utility>

using namespace efree;
using efree::bench::cpu_seconds;

namespace {

void row(const LabelImage<3>& image, const ImageMeshOptions& options) {
  double solid = 0.0;
  for (const LabelCount& count : count_labels(image))
    if (count.label != 0) solid += static_cast<double>(count.pixels) / static_cast<double>(image.labels.size());
  LatticeMesh made;
  const double start = cpu_seconds();
  if (options.mesher == Mesher::lattice)
    made = mesh_on_lattice(image, options);
  else
    made.mesh = mesh_image<3>(image, options);
  const double meshed = cpu_seconds();
  const FineMesh<3> mesh(std::move(made.mesh));
  const double done = cpu_seconds();
  double flattest = 1.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    flattest = std::min(flattest, internal::flatness<3>(mesh.vertices(), mesh.cells(), c));
  std::printf("| %d | %g | %d | %d | %.3f | %.3f | %.5f | %.5f | %d | %.1e | %d | %d | %.0f | %d |\n", image.size[0],
              options.size, mesh.num_cells(), mesh.num_vertices(), meshed - start, done - meshed, solid,
              mesh.volumes().sum() / static_cast<double>(image.labels.size()), mesh.num_components(), flattest,
              made.lost.parts, made.lost.pieces, made.lost.worst_volume, made.lost.broken_off);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::printf(
      "| voxels | size | tetrahedra | vertices | mesh [s] | FineMesh [s] | solid voxels | solid | bodies | flattest | "
      "lost parts | lost pieces | largest [voxels] | broken off |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  if (argc > 1 && std::string_view(argv[1]) == "gyroid") {
    const auto image = bench::gyroid_labels(96);
    for (const double size : {1.0, 1.5, 2.0, 2.5, 3.0, 4.0}) row(image, {.size = size});
    return 0;
  }
  const Index voxels = argc > 1 ? std::atoi(argv[1]) : 128;
  const double size = argc > 2 ? std::atof(argv[2]) : 2.5;
  const bool delaunay = argc > 3 && std::string_view(argv[3]) == "delaunay";
  row(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0}),
      {.size = size, .mesher = delaunay ? Mesher::delaunay : Mesher::lattice});
}
