// SPDX-License-Identifier: GPL-3.0-or-later
/// Convergence on the spherical cavity: errors against nodes and against time, one line a run, for both secondary
/// bases and full integration on a fine mesh (which end one step before the others), for cells on a coarse mesh with
/// linear and quadratic interpolation, and for P1 and P2 tetrahedra with about as many unknowns as the coarse mesh has
/// vertices. Seconds are CPU seconds of the whole (mesh included) and of the mesh, those of the stages wall-clock ones.
/// Writes CSV to standard output, observed orders to standard error.
///
///   bench_spherical_cavity [finest spacing = 0.2] [seeds = 1] [first method = 0] [last method = 6]
#include "clock.hpp"
#include "efree/bench/cavity.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;
using bench::Cavity;
using efree::bench::cpu_seconds;
using efree::bench::median;

namespace {

struct Method {
  const char* name;
  BasisKind kind;
  SecondaryKind secondary;
  int interpolation;
  double ratio;  ///< spacing over size of the tetrahedra
};
constexpr double fine = 4.0, coarse = 2.5;
constexpr Method methods[] = {{"cells", BasisKind::mls, SecondaryKind::cells, 1, fine},
                              {"mls", BasisKind::mls, SecondaryKind::mls, 1, fine},
                              {"full", BasisKind::mls, SecondaryKind::full, 1, fine},
                              {"p1", BasisKind::p1, SecondaryKind::full, 1, 2.5},
                              {"p2", BasisKind::p2, SecondaryKind::full, 2, 1.25},
                              {"coarse", BasisKind::mls, SecondaryKind::cells, 1, coarse},
                              {"quadratic", BasisKind::mls, SecondaryKind::cells, 2, coarse}};

}  // namespace

int main(int argc, char** argv) {
  const double finest = argc > 1 ? std::atof(argv[1]) : 0.2;
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 1;
  const int first = argc > 3 ? std::atoi(argv[3]) : 0, last = argc > 4 ? std::atoi(argv[4]) : 6;
  std::printf(
      "method,spacing,seed,fine_vertices,fine_cells,nodes,points,l2,energy,recovered,seconds,mesh,cloud,weights,basis,"
      "quadrature,assembly,solve\n");
  for (int m = first; m <= last; ++m) {
    const Method& method = methods[m];
    const bool elements = method.kind != BasisKind::mls;
    std::vector<double> spacings, l2, energy, recovered;
    const double end = method.ratio == fine ? std::sqrt(2.0) * finest : finest;
    for (double H = 0.8; H > 0.99 * end; H *= std::sqrt(0.5)) spacings.push_back(H);
    for (const double H : spacings) {
      const double before = cpu_seconds();
      const FineMesh<3> mesh = Cavity::mesh(H / method.ratio);
      const double mesh_seconds = cpu_seconds() - before;
      std::vector<double> of_seeds[3];
      for (int seed = 1; seed <= (elements ? 1 : seeds); ++seed) {
        StageTimes times;
        const Monitor monitor{.times = &times};
        const double start = cpu_seconds();
        const auto approximation = approximate(mesh,
                                               {.kind = method.kind,
                                                .interpolation = method.interpolation,
                                                .spacing = H,
                                                .seed = static_cast<std::uint64_t>(seed),
                                                .secondary = method.secondary},
                                               monitor);
        const auto solver = Cavity::solver(approximation, elements ? Essential::strong : Essential::nitsche, monitor);
        Solution<3> solution;
        {
          const Stage stage("solve", monitor);
          solution = solver.solve(Cavity::loads());
        }
        const double seconds = mesh_seconds + cpu_seconds() - start;
        const Errors errors = Cavity::errors(approximation, solution);
        std::printf("%s,%.4f,%d,%d,%d,%td,%d,%.4e,%.4e,%.4e,%.3f,%.3f", method.name, H, seed, mesh.num_vertices(),
                    mesh.num_cells(), approximation.nodes.cols(), approximation.quadrature.size(),
                    *errors.l2_displacement, *errors.energy_norm, *errors.energy_norm_recovered, seconds, mesh_seconds);
        for (const char* stage : {"cloud", "weights", "basis", "quadrature", "assembly", "solve"})
          std::printf(",%.3f", times[stage]);
        std::printf("\n");
        std::fflush(stdout);
        of_seeds[0].push_back(*errors.l2_displacement);
        of_seeds[1].push_back(*errors.energy_norm);
        of_seeds[2].push_back(*errors.energy_norm_recovered);
      }
      l2.push_back(median(of_seeds[0]));
      energy.push_back(median(of_seeds[1]));
      recovered.push_back(median(of_seeds[2]));
    }
    const double span = std::log(spacings.front() / spacings.back());
    const auto order = [&](const std::vector<double>& errors) {
      return std::log(errors.front() / errors.back()) / span;
    };
    std::fprintf(stderr, "%s: observed orders L2 %.2f, energy %.2f, recovered %.2f\n", method.name, order(l2),
                 order(energy), order(recovered));
  }
}
