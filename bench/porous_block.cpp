// SPDX-License-Identifier: GPL-3.0-or-later
/// A block with spherical pores from a label image, stretched along z between sliding plates: effective stiffness, time
/// and memory of the coarse cloud against P1 tetrahedra on the same fine mesh. Every line is a process of its own, so
/// that peak memory is that of the method.
///
/// The image is meshed by Delaunay refinement, with --lattice on a lattice.
/// With --surface the block comes as an STL file, the boundary of a mesh of that image, and is meshed again from that
/// alone.
///
///   bench_porous_block [--surface | --lattice] [voxels a side = 128] [fine size in voxels = 3] [method = all | p1 |
///   SPACING]
#include "efree/geometry/input/label_image.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/mesh/selection.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

using namespace efree;

namespace {

double peak_gib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / (1024.0 * 1024.0);
}

enum class Source { delaunay, lattice, surface };

FineMesh<3> from_image(Index voxels, double size, Mesher mesher = Mesher::delaunay) {
  const auto image = keep_largest(random_spheres<3>(voxels, {.porosity = 0.3, .r_min = 6.0, .r_max = 14.0})).image;
  MeshData<3> mesh = mesh_image<3>(image, {.size = size, .mesher = mesher});
  // Necks thinner than the lattice break.
  if (mesher == Mesher::lattice) mesh = keep_largest(std::move(mesh)).mesh;
  return FineMesh<3>(mesh);
}

/// Where the block is written as a surface.
std::string stl_file() {
  return (std::filesystem::temp_directory_path() / "efree_porous_block.stl").string();
}
void write_stl(const FineMesh<3>& mesh) {
  std::ofstream file(stl_file());
  file.precision(17);
  file << "solid block\n";
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    file << "facet normal 0 0 0\nouter loop\n";
    for (int k = 0; k < 3; ++k) file << "vertex " << mesh.vertex(mesh.facets()(k, f)).transpose() << '\n';
    file << "endloop\nendfacet\n";
  }
  file << "endsolid\n";
}
FineMesh<3> from_surface(Index voxels, double size) {
  // Necks thinner than cells are lost, so that there may be islands.
  FineMesh<3> mesh(keep_largest(mesh_surface(read_surface(stl_file()),
                                             {.size = size, .feature_angle = 60.0, .distance = 0.1 * size}))
                       .mesh);
  std::vector<FineMesh<3>::Group> sides;
  for (const auto& [name, axis, at] : {std::tuple{"left", 0, 0}, {"front", 1, 0}, {"bottom", 2, 0}, {"top", 2, voxels}})
    sides.push_back({name, select_facets<3>(mesh, OnPlane<3>{Vec<3>::Constant(at), Vec<3>::Unit(axis), 0.01})});
  return std::move(mesh).with_groups(sides);
}

/// spacing 0: P1 elements.
void run(Source source, Index voxels, double size, double spacing) {
  StageTimes times;
  const Monitor monitor{.times = &times};
  std::optional<FineMesh<3>> mesh;
  {
    const Stage stage("mesh", monitor);
    mesh.emplace(source == Source::surface
                     ? from_surface(voxels, size)
                     : from_image(voxels, size, source == Source::lattice ? Mesher::lattice : Mesher::delaunay));
  }
  const double before = peak_gib();
  const bool elements = spacing == 0.0;
  const auto approximation =
      approximate(*mesh, {.kind = elements ? BasisKind::p1 : BasisKind::mls, .spacing = spacing}, monitor);
  const double basis_bytes = (peak_gib() - before) * 1024.0 * 1024.0 * 1024.0 / mesh->num_vertices();
  DisplacementCondition<3> pulled{"top", {}, [voxels](const Vec<3>&) { return 0.01 * voxels; }};
  const ElasticSolver<3> solver(
      approximation,
      {.material = LinearElastic(1.0, 0.3), .essential = elements ? Essential::strong : Essential::nitsche},
      {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom"), pulled}, monitor);
  Solution<3> solution;
  {
    const Stage stage("solve", monitor);
    solution = solver.solve({});
  }
  // Effective modulus: energy = E_eff strain^2 volume / 2.
  const double modulus = 2.0 * solution.strain_energy / (1e-4 * std::pow(voxels, 3));
  std::printf(
      "| %s | %d | %d | %td | %d | %.5f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.0f |\n",
      elements ? "P1" : std::to_string(spacing).substr(0, 5).c_str(), mesh->num_cells(), mesh->num_vertices(),
      approximation.nodes.cols(), approximation.quadrature.size(), modulus, times["mesh"], times["cloud"],
      times["weights"], times["basis"], times["quadrature"], times["assembly"], times["solve"],
      times.total() - times["mesh"], peak_gib(), basis_bytes);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view option = argc > 1 ? argv[1] : "";
  const Source source = option == "--surface"   ? Source::surface
                        : option == "--lattice" ? Source::lattice
                                                : Source::delaunay;
  if (source != Source::delaunay) --argc, ++argv;
  const Index voxels = argc > 1 ? std::atoi(argv[1]) : 128;
  const double size = argc > 2 ? std::atof(argv[2]) : 3.0;
  const std::string method = argc > 3 ? argv[3] : "all";
  if (source == Source::surface) write_stl(from_image(voxels, 3.0));
  if (method != "all") return run(source, voxels, size, method == "p1" ? 0.0 : std::atof(method.c_str())), 0;
  std::printf(
      "| spacing [voxels] | tetrahedra | fine vertices | nodes | points | effective modulus / E | mesh [s] | cloud | "
      "weights "
      "| basis | quadrature | assembly | solve | all but mesh [s] | peak [GiB] | basis, bytes per fine vertex |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  std::fflush(stdout);
  for (const double spacing : {20.0, 14.0, 10.0, 7.0, 5.5, 0.0}) {
    const pid_t child = fork();
    if (child == 0) {
      run(source, voxels, size, spacing);
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    if (status != 0) std::printf("| %g | failed |\n", spacing);
  }
}
