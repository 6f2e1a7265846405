// SPDX-License-Identifier: GPL-3.0-or-later
/// One case from mesh to fields.
#pragma once

#include "efree/io/case_file.hpp"

#include <memory>
#include <optional>

namespace efree {

/// A mesh, and the time it took.
struct CaseMesh {
  std::shared_ptr<const FineMesh<2>> mesh;
  double seconds = 0.0, cpu_seconds = 0.0;
};

struct CaseResult {
  std::shared_ptr<const FineMesh<2>> mesh;
  Approximation<2> approximation;  ///< refers to *mesh
  Solution<2> solution;
  Fields<2> fields;
  std::optional<Errors> errors;                                ///< if the case knows an exact solution
  std::vector<std::pair<std::string, ProbeValues<2>>> probes;  ///< in the order of the case

  std::vector<std::string> warnings;  ///< what makes the numbers doubtful

  /// Wall-clock seconds: mesh, cloud, weights, basis, quadrature, assembly, solve, output (recovery, errors, probes,
  /// files).
  StageTimes times;
  double cpu_seconds = 0.0;  ///< of all threads, from mesh to solve
};

/// Fine mesh size of the case [length]; 0 leaves it to the file.
double mesh_size(const Case& analysis);

/// Reads the mesh of the case (stage "mesh") and checks that every boundary the case names is there and every probe
/// inside the body. Throws InputError beginning with the place in the case file.
CaseMesh read_mesh(const Case& analysis, const Progress& progress = {});

/// Runs a case on its mesh. The driver does not know which basis it runs on. Throws InputError beginning with the place
/// in the case file (free rigid motion, spacing larger than the body) and NumericalError.
CaseResult solve_case(const Case& analysis, const CaseMesh& mesh, const Progress& progress = {});
CaseResult solve_case(const Case& analysis, const Progress& progress = {});

/// Largest resident memory of this process so far [MiB].
double peak_memory_mb();

}  // namespace efree
