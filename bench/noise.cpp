// SPDX-License-Identifier: GPL-3.0-or-later
/// Images of noise, from image to corrected answer: bodies too small for nodes, free bodies, iterations.
///
///   bench_noise [images = 51] [voxels = 20] [tolerance = 0.01] [linear elements alone, too = 0]
///   bench_noise labels [voxels = 48] [tolerance = 0.01]
///   bench_noise defaults [sheet | grey | labels = sheet] [voxels = 96] [degree of the elements = 1; 0: as chosen, on
///   cells] [quarters]
///
/// The labels are smoothed voxels / 12 times. `defaults` is the way of the command line: the image and a case file
/// without mesh_size and spacing are written to the folder for temporary files and read again. The elements are then
/// solved by corrections to 1e-7 in the energy norm. The truth of cells is extrapolated from halves of voxels, or from
/// quarters (96^3: 12 GiB).
#include "noise.hpp"
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "gyroid.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <string>

using namespace efree;
using namespace efree::bench;

namespace {

void study(const char* name, Case<3> analysis, double tolerance, bool elements) {
  analysis.correction.tolerance = tolerance;
  analysis.largest_error = 1e9;  // the fine mesh of noise is far from any truth
  try {
    const PreparedMesh<3> mesh = prepare(analysis);
    double left_out = 0.0;
    Index free_bodies = 0, hinges = 0;
    for (const auto& [key, value] : mesh.reports) {
      if (key == "free_bodies") free_bodies = std::get<Index>(value);
      if (key == "free_bodies_fraction") left_out = std::get<double>(value);
      if (key == "hinges_cut") hinges = std::get<Index>(value);
    }
    const Result<3> result = analyse(mesh, analysis);
    double off = 0.0;
    if (elements) {
      analysis.common.approximation.kind = BasisKind::p1;
      analysis.common.model.essential = Essential::strong;
      const Result<3> direct = analyse(analysis);
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

/// A case file with an image beside it, all else as chosen: held on the left, pulled by a hundredth on the right.
std::filesystem::path write_case(const std::string& name, Index n, int degree) {
  const auto folder = std::filesystem::temp_directory_path() / "efree_bench_noise";
  std::filesystem::create_directories(folder);
  const bool labels = name == "labels";
  std::ofstream image(folder / (name + ".raw"), std::ios::binary);
  const auto write = [&](const auto& values) {
    image.write(reinterpret_cast<const char*>(values.data()),
                static_cast<std::streamsize>(values.size() * sizeof(values[0])));
  };
  if (labels)
    write(noise_of_three_labels(n, n / 12, 1).labels);
  else
    write(name == "grey" ? noise(2, 0.5, 1, n).grey : gyroid_sheet(n).grey);
  const auto file = folder / (name + ".toml");
  std::ofstream text(file);
  text << "[geometry]\nfile = \"" << name << ".raw\"\n[geometry.image]\n"
       << (labels ? "" : "threshold = 0\n") << "raw = { size = [" << n << ", " << n << ", " << n << "], type = \""
       << (labels ? "uint16" : "float32") << "\" }\n";
  if (labels)
    for (const auto& [label, modulus] : {std::pair{1, 1}, {2, 10}, {3, 100}})
      text << "[[material]]\nregion = \"" << label << "\"\nE = " << modulus << "\nnu = 0.3\n";
  else
    text << "[material]\nE = 1\nnu = 0.3\n";
  if (degree > 0) text << "[basis]\ninterpolation = " << degree << '\n';
  text << "[[boundary]]\non = \"left\"\ndisplacement = [0, 0, 0]\n[[boundary]]\non = \"right\"\ndisplacement = ["
       << 0.01 * n << ", 0, 0]\n";
  return file;
}

void study_defaults(const std::string& name, Index n, int degree, bool quarters) {
  auto analysis = std::get<Case<3>>(read_case(write_case(name, n, degree)));
  if (const auto found = analyse_image(analysis)) {
    const double peak = peak_memory_mb();
    std::vector<SharedMaterial> materials;
    for (const Index region : found->region_of_label)
      materials.push_back(region < 0 ? SharedMaterial() : found->materials[region]);
    const auto on_cells = [&](double size) {
      return solve_on_cells(*found->image, materials, analysis.supports, analysis.loads, {.size = size});
    };
    const CellSolution fine = on_cells(1.0), finer = on_cells(0.5);
    std::optional<CellSolution> finest;
    if (quarters) finest = on_cells(0.25);
    const double truth = (finest ? *finest : finer).extrapolated_energy;
    const auto line = [&](const char* what, const CellSolution& solution, double seconds) {
      const double energy = solution.finest().strain_energy, error = std::sqrt(std::abs(energy / truth - 1.0));
      std::printf("| %s | %d | %s | %d | %.6g | %+.2f | %+.2f | %.3g | %.3g | %.2f | %d | %.2g | %.1f |\n",
                  name.c_str(), n, what, solution.finest().cells, energy, 100.0 * (energy / truth - 1.0),
                  100.0 * (solution.extrapolated_energy / truth - 1.0), 100.0 * solution.grid_error, 100.0 * error,
                  solution.grid_error / error, solution.finest().iterations, 100.0 * solution.half_voxel, seconds);
    };
    std::printf(
        "| image | voxels | cells of | number | energy | off [%%] | extrapolated off [%%] | said [%%] | true [%%] | "
        "ratio | iterations | half a voxel [%%] | CPU [s] |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    line("default", *found->cells, found->cpu_seconds);
    line("1", fine, 0.0);
    line("1/2", finer, 0.0);
    if (finest) line("1/4", *finest, 0.0);
    std::printf("default: %.0f MiB, warnings: %zu%s\n", peak, found->warnings.size(),
                found->refusal.empty() ? "" : ", refused");
    return;
  }
  const PreparedMesh<3> mesh = prepare(analysis);
  for (const std::string& remark : mesh.remarks) std::fprintf(stderr, "%s\n", remark.c_str());
  const Result<3> result = analyse(mesh, analysis);
  const double peak = peak_memory_mb();
  const Estimates& said = *result.estimates;

  const auto alone = ElasticSolver<3>(result.approximation, result.model, analysis.supports).solve(analysis.loads);
  const auto elements = [&](const Approximation<3>& cloud) {
    return Corrector<3>(cloud, result.model, analysis.supports)
        .correct(interpolate(cloud.shape, alone.coefficients), analysis.loads, {.tolerance = 1e-7, .most = 1000});
  };
  // What is said of the cloud is against elements of its own degree; the answer may be of quadratic ones.
  const auto truth = elements(result.approximation);
  const int answered = result.basis().space.degree();
  const double energy = answered == result.approximation.space.degree()
                            ? truth.strain_energy
                            : elements(in_quadratic_space(result.approximation)).strain_energy;
  const double left = std::sqrt(std::abs(result.solution.strain_energy / energy - 1.0));
  std::printf(
      "| %s | %d | P%d | %d | %td | %.6g | %.6g | %.6g | %+.2g | %+.2g | %.3g | %.3g | %.2f | %.2g | %.2g | %.2f | %d "
      "| "
      "%.2g | %.1f | %.0f |\n",
      name.c_str(), n, answered, mesh.mesh->num_cells(), result.approximation.nodes.cols(), alone.strain_energy,
      result.solution.strain_energy, energy, 100.0 * (alone.strain_energy / energy - 1.0),
      100.0 * (result.solution.strain_energy / energy - 1.0), 100.0 * said.uncorrected, 100.0 * truth.start_error,
      said.uncorrected / truth.start_error, 100.0 * said.cloud, 100.0 * left, said.cloud / left, said.corrections,
      100.0 * said.mesh, result.cpu_seconds, peak);
  if (!result.refusal.empty()) std::fprintf(stderr, "%s: refused, %s\n", name.c_str(), result.refusal.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "defaults") {
    const int degree = argc > 4 ? std::atoi(argv[4]) : 1;
    if (degree > 0)
      std::printf(
          "| image | voxels | cells of | number | nodes | energy, cloud | answer | elements | cloud off [%%] | answer "
          "off "
          "[%%] | said of the cloud [%%] | true | ratio | said of the answer [%%] | true | ratio | iterations | said "
          "of "
          "the "
          "mesh [%%] | CPU [s] | MiB "
          "|\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    study_defaults(argc > 2 ? argv[2] : "sheet", argc > 3 ? std::atoi(argv[3]) : 96, degree, argc > 5);
    return 0;
  }
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
