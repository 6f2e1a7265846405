// SPDX-License-Identifier: GPL-3.0-or-later
/// Images of noise, from image to corrected answer: bodies too small for nodes, free bodies, iterations.
///
///   bench_noise [images = 51] [voxels = 20] [tolerance = 0.01] [linear elements alone, too = 0]
///   bench_noise labels [voxels = 48] [tolerance = 0.01]
#include "noise.hpp"
#include "efree/core/error.hpp"

#include <cstdio>
#include <cstdlib>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

void study(const char* name, Case<3> analysis, double tolerance, bool elements) {
  analysis.correction.tolerance = tolerance;
  analysis.largest_error = 1e9;  // the fine mesh of noise is far from any truth
  try {
    const CaseMesh<3> mesh = read_mesh(analysis);
    double left_out = 0.0;
    Index free_bodies = 0, hinges = 0;
    for (const auto& [key, value] : mesh.reports) {
      if (key == "free_bodies") free_bodies = std::get<Index>(value);
      if (key == "free_bodies_fraction") left_out = std::get<double>(value);
      if (key == "hinges_cut") hinges = std::get<Index>(value);
    }
    const CaseResult<3> result = solve_case(analysis, mesh);
    double off = 0.0;
    if (elements) {
      analysis.approximation.kind = BasisKind::p1;
      analysis.model.essential = Essential::strong;
      const CaseResult<3> direct = solve_case(analysis);
      off = result.solution.strain_energy / direct.solution.strain_energy - 1.0;
    }
    std::printf("| %s | %d | %d | %d | %.2g | %d | %d | %td | %d | %d | %.3g | %.2g | %d | %.5g | %.1e | %.1f |\n",
                name, mesh.mesh->num_vertices(), mesh.mesh->num_components(), free_bodies, left_out, hinges,
                result.approximation.small_bodies, result.approximation.nodes.cols(),
                result.approximation.mls.own_functions, result.approximation.quadrature.size(),
                result.estimates->uncorrected, result.estimates->cloud, result.estimates->corrections,
                result.solution.strain_energy, off, result.cpu_seconds);
  } catch (const std::exception& error) {
    std::printf("| %s | %s |\n", name, std::string(error.what()).substr(0, 300).c_str());
  }
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::printf(
      "| image | vertices | bodies | left out | their share | hinges | small | nodes | own functions | points | error "
      "of the "
      "cloud | left | iterations | energy | energy / linear elements - 1 | CPU [s] |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  if (argc > 1 && std::string(argv[1]) == "labels") {
    const Index n = argc > 2 ? std::atoi(argv[2]) : 48;
    const double tolerance = argc > 3 ? std::atof(argv[3]) : 0.01;
    for (const int passes : {2, 1, 0})
      study(("labels, smoothed " + std::to_string(passes)).c_str(),
            pulled(noise_of_three_labels(n, passes, 1), 1.5, {1.0, 10.0, 100.0}), tolerance, false);
    return 0;
  }
  const int images = argc > 1 ? std::atoi(argv[1]) : 51;
  const Index n = argc > 2 ? std::atoi(argv[2]) : 20;
  const double tolerance = argc > 3 ? std::atof(argv[3]) : 0.01;
  for (int k = 0; k < images; ++k) {
    const double solid = 0.2 + 0.7 * (k / 3) / std::max(1, (images - 1) / 3);
    study(("kind " + std::to_string(k % 3) + ", solid " + std::to_string(solid)).c_str(),
          pulled(noise(k % 3, solid, static_cast<unsigned>(k), n), 1.0, {1.0}), tolerance,
          argc > 4 && std::atoi(argv[4]) != 0);
  }
}
