// SPDX-License-Identifier: GPL-3.0-or-later
/// Case files with the mesh and the cloud that are chosen where nothing is said, against quadratic elements on the same
/// mesh, fully solved: energy, largest displacement, what the estimate said.
///
///   bench_defaults [written | default] CASE.toml...
///
/// `default` leaves out mesh_size, mesh_ratio and spacing (boxes and regions of a cloud stay), `written` nothing. The
/// quadratic elements are solved by CHOLMOD on up to 3e5 unknowns, beyond by corrections to 1e-3 in the energy norm
/// (1e-6 of the energy).
#include "efree/core/memory.hpp"
#include "efree/io/case/case_file.hpp"

#include <cstdio>
#include <cstring>
#include <string>

using namespace efree;

namespace {

struct Measure {
  double energy, largest_displacement;
};
template <int Dim> Measure measure(double energy, const Points<Dim>& displacement) {
  return {energy, displacement.colwise().norm().maxCoeff()};
}
double percent(double value, double truth) {
  return 100.0 * (value / truth - 1.0);
}

/// Quadratic elements on the mesh of the result.
template <int Dim> Measure truth(Case<Dim> analysis, const Result<Dim>& result, const PreparedMesh<Dim>& mesh) {
  const double unknowns = Dim * (mesh.mesh->num_vertices() + (Dim == 2 ? 1.5 : 1.2) * mesh.mesh->num_cells());
  // Elements have their regions share nodes; the mesh of moving least squares is cut along their interfaces.
  const bool cut = mesh.mesh->num_regions() > 1;
  if (!result.estimates || (unknowns < 3e5 && !cut)) {
    analysis.common.approximation = {.kind = BasisKind::p2};
    analysis.common.model.essential = Essential::strong;
    const Result<Dim> direct = cut ? analyse(analysis) : analyse(mesh, analysis);
    return measure<Dim>(direct.solution.strain_energy, direct.fields.displacement);
  }
  const bool linear = result.approximation.space.degree() == 1;
  const Approximation<Dim> raised = linear ? in_quadratic_space(result.approximation) : Approximation<Dim>{};
  const Approximation<Dim>& quadratic = linear ? raised : result.approximation;
  const auto from = interpolate(
      quadratic.shape,
      ElasticSolver<Dim>(result.approximation, result.model, analysis.supports).solve(analysis.loads).coefficients);
  const auto correction = Corrector<Dim>(quadratic, result.model, analysis.supports)
                              .correct(from, analysis.loads, {.tolerance = 1e-3, .most = 1000});
  return measure<Dim>(correction.strain_energy, correction.displacement);
}

template <int Dim> void study(const std::string& name, Case<Dim> analysis, bool defaults) {
  if (defaults) {
    analysis.geometry.size = analysis.geometry.ratio = 0.0;
    analysis.common.approximation.spacing = 0.0;
  }
  analysis.largest_error = 1e9;  // how wrong an answer is matters more here than that it would be refused
  const PreparedMesh<Dim> mesh = prepare(analysis);
  const Result<Dim> result = analyse(mesh, analysis);
  const double seconds = result.cpu_seconds, peak = peak_memory_mb();
  const Measure answer = measure<Dim>(result.solution.strain_energy, result.fields.displacement);
  Measure cloud = answer;
  if (result.elements) {
    const auto alone = ElasticSolver<Dim>(result.approximation, result.model, analysis.supports).solve(analysis.loads);
    cloud = measure<Dim>(alone.strain_energy, interpolate(result.approximation.shape, alone.coefficients));
  }
  const Measure exact = truth(analysis, result, mesh);
  std::printf("| %s | %d | %td | %d | %.6g | %+.2g | %+.2f | %+.2f | %.4g | %+.2g | %+.2f |", name.c_str(),
              mesh.mesh->num_cells(), result.approximation.nodes.cols(), result.basis().space.degree(), exact.energy,
              percent(cloud.energy, exact.energy), percent(answer.energy, exact.energy),
              result.estimates ? -100.0 * result.estimates->total() * result.estimates->total() : 0.0,
              exact.largest_displacement, percent(cloud.largest_displacement, exact.largest_displacement),
              percent(answer.largest_displacement, exact.largest_displacement));
  if (result.estimates)
    std::printf(" %.2g | %d | %.2g | %.2g |", 100.0 * result.estimates->uncorrected, result.estimates->corrections,
                100.0 * result.estimates->cloud, 100.0 * result.estimates->mesh);
  else
    std::printf(" - | - | - | - |");
  std::printf(" %.1f | %.0f |\n", seconds, peak);
}

}  // namespace

int main(int argc, char** argv) {
  const bool known = argc > 2 && (std::strcmp(argv[1], "written") == 0 || std::strcmp(argv[1], "default") == 0);
  if (!known) return std::fprintf(stderr, "bench_defaults written | default CASE.toml...\n"), 1;
  std::printf(
      "| case | cells | nodes | degree | energy, P2 | cloud [%%] | answer [%%] | estimated [%%] | largest "
      "displacement, P2 | cloud [%%] | answer [%%] | estimates: cloud [%%] | corrections | left [%%] | mesh [%%] | CPU "
      "[s] | MiB |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (int k = 2; k < argc; ++k) {
    const std::string path = argv[k], name = path.substr(path.find_last_of('/') + 1);
    try {
      std::visit([&](const auto& analysis) { study(name, analysis, std::strcmp(argv[1], "default") == 0); },
                 read_static_case(path));
    } catch (const std::exception& error) {
      std::printf("| %s | %s |\n", name.c_str(), error.what());
    }
    std::fflush(stdout);
  }
}
