// SPDX-License-Identifier: GPL-3.0-or-later
// bench_plane_impact 2|3 SIZE SPEED ... [key=value ...]: an aluminium bar against a wall, held at its sides, on meshes
// of no symmetry, at these speeds [m/s]: the momentum it has lost when the front is well within, over that by Rankine
// and Hugoniot; and next to the wall the volume of the points over that of the cells between the nodes. CSV; lines that
// begin with # say what went wrong. Keys: meshes (how many, each 2 % finer than the last), jitter (1: nodes off by up
// to 0.45 edges, in the plane), linear, quadratic (artificial viscosity), reconnection_strain, stabilisation, shared
// (0: points keep their dilatation).
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include "arguments.hpp"
#include "bad_meshes.hpp"
#include "clock.hpp"
#include "plane_impact.hpp"

#include <Eigen/LU>
#include <cstdio>
#include <cstdlib>
#include <vector>

namespace efree {
namespace {

using bench::Keys;
using bench::PlaneImpact;

/// Volume of points next to the wall by their deformation, over that of the cells there.
template <int Dim> double volume_of_points(const FineMesh<Dim>& mesh, const Dynamics<Dim>& dynamics) {
  double by_points = 0.0, by_cells = 0.0;
  const Tensors F = dynamics.deformation();
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    if (mesh.centroid(c)[Dim - 1] > 0.4 * PlaneImpact::length) continue;
    Mat<Dim> edges;
    for (int i = 0; i < Dim; ++i)
      edges.col(i) = dynamics.nodes().col(mesh.cells()(i + 1, c)) - dynamics.nodes().col(mesh.cells()(0, c));
    by_points += mesh.volumes()[c] * Eigen::Map<const Mat<3>>(F.col(c).data()).determinant();
    by_cells += edges.determinant() / (Dim == 2 ? 2.0 : 6.0);
  }
  return by_points / by_cells;
}

template <int Dim> void hit(double size, const std::vector<double>& speeds, const Keys& keys) {
  const auto value = [&](const char* name, double otherwise) {
    const auto found = keys.find(name);
    return found == keys.end() ? otherwise : found->second;
  };
  const OtmOptions scheme{.reconnection_strain = value("reconnection_strain", OtmOptions{}.reconnection_strain),
                          .stabilisation = value("stabilisation", OtmOptions{}.stabilisation)};
  const DynamicsOptions options{.shock = {value("linear", 0.5), value("quadratic", 2.0)}};
  std::puts(
      "dim,size,mesh,points,speed,lost,of_exact,reconnection,energy_error,volume_of_points,reconnections,steps,"
      "seconds");
  for (const double speed : speeds)
    for (int k = 0; k < value("meshes", 1); ++k) {
      FineMesh<Dim> mesh = PlaneImpact::mesh<Dim>(size * (1.0 - 0.02 * k));
      if constexpr (Dim == 2)
        if (value("jitter", 0.0) != 0.0) mesh = bench::jittered(mesh, size, k + 1);
      const double begin = bench::cpu_seconds();
      auto dynamics = PlaneImpact::bar<Dim>(mesh, speed, scheme, options, value("shared", 1.0) != 0.0);
      const auto before = dynamics.balance();
      try {
        dynamics.run(PlaneImpact::until);
      } catch (const NumericalError& error) {
        std::printf("# %g m/s, mesh %d: %s\n", speed, k, error.what());
      }
      const auto after = dynamics.balance();
      const double lost = 1.0 - after.momentum[Dim - 1] / before.momentum[Dim - 1];
      std::printf("%d,%g,%d,%d,%g,%.4f,%.4f,%.4f,%.2g,%.4f,%.2f,%d,%.3g\n", Dim, size, k, dynamics.num_points(), speed,
                  lost, lost / PlaneImpact::momentum_lost(speed), after["reconnection"] / before["kinetic"],
                  after.total() / before.total() - 1.0, volume_of_points(mesh, dynamics),
                  static_cast<double>(dynamics.count("reconnections")) / dynamics.num_points(), dynamics.steps(),
                  bench::cpu_seconds() - begin);
      std::fflush(stdout);
    }
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  if (argc < 4) return std::puts("bench_plane_impact 2|3 SIZE SPEED ... [key=value ...]"), 2;
  const auto [speeds, keys] = efree::bench::arguments(argc, argv, 3);
  efree::set_num_threads(1);
  if (std::atoi(argv[1]) == 2)
    efree::hit<2>(std::atof(argv[2]), speeds, keys);
  else
    efree::hit<3>(std::atof(argv[2]), speeds, keys);
}
