// SPDX-License-Identifier: GPL-3.0-or-later
/// One case from mesh to fields.
#pragma once

#include "efree/io/case_file.hpp"

#include <cmath>
#include <memory>
#include <optional>

namespace efree {

/// A mesh, what was found on it, and the time it took.
template <int Dim> struct CaseMesh {
  /// A part of the boundary that the case uses.
  struct Part {
    std::string name;
    Index facets = 0;
    double measure = 0.0;  ///< area, in 2D length
  };

  std::shared_ptr<const FineMesh<Dim>> mesh;
  std::vector<LinearElastic> materials;  ///< by region of the mesh
  std::string open_interface;            ///< part along which regions are not tied; empty: tied wherever they touch
  std::vector<Part> parts;               ///< in the order of the case
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry
  std::vector<std::string> remarks;                       ///< what to tell the user: the same in words, the parts
  double seconds = 0.0, cpu_seconds = 0.0;
};

/// Relative errors in the energy norm.
struct Estimates {
  double cloud;        ///< of the answer, against the finite elements of the fine mesh
  double uncorrected;  ///< of the cloud's own answer, against them
  double mesh;         ///< of these finite elements, by recovery
  int corrections;     ///< iterations that led to the answer
  double total() const { return std::hypot(cloud, mesh); }
};

template <int Dim> struct CaseResult {
  std::shared_ptr<const FineMesh<Dim>> mesh;
  ElasticModel model;                ///< with the materials of all regions
  Approximation<Dim> approximation;  ///< refers to *mesh
  /// Finite elements of the fine mesh that `solution` belongs to if it is corrected; else it is of `approximation`.
  std::optional<Approximation<Dim>> elements;
  Solution<Dim> solution;
  std::optional<Estimates> estimates;  ///< none for finite elements, nor where dilatations are averaged
  Fields<Dim> fields;
  /// What `solution` and `fields` belong to.
  const Approximation<Dim>& basis() const { return elements ? *elements : approximation; }

  std::optional<Errors> errors;                                  ///< if the case knows an exact solution
  std::vector<std::pair<std::string, ProbeValues<Dim>>> probes;  ///< in the order of the case
  std::vector<typename CaseMesh<Dim>::Part> parts;               ///< of the boundary
  std::vector<std::pair<std::string, Reported>> reports;         ///< of the geometry

  std::vector<std::string> warnings;  ///< what makes the numbers doubtful
  std::string refusal;                ///< why they are no answer; empty if they are one

  /// Wall-clock seconds: mesh, cloud, weights, basis, quadrature, assembly, solve, correction, output (recovery,
  /// errors, probes, files).
  StageTimes times;
  double cpu_seconds = 0.0;  ///< of all threads, from mesh to solve
};

/// Fine mesh size of the case [length]; 0 leaves it to the file.
template <int Dim> double mesh_size(const Case<Dim>& analysis);

/// Reads or makes the mesh of the case (stage "mesh"), for moving least squares parted along the interfaces between
/// regions; finds its selections, which become named parts of the boundary; and checks that every boundary and every
/// region the case names is there, that every region has a material and every probe lies inside the body. Interfaces
/// between regions belong to no part. Throws InputError beginning with the place in the case file.
template <int Dim> CaseMesh<Dim> read_mesh(const Case<Dim>& analysis, const Progress& progress = {});

/// Runs a case on its mesh. The driver does not know which basis it runs on. Throws InputError beginning with the place
/// in the case file (free rigid motion, spacing larger than the body) and NumericalError.
template <int Dim>
CaseResult<Dim> solve_case(const Case<Dim>& analysis, const CaseMesh<Dim>& mesh, const Progress& progress = {});
template <int Dim> CaseResult<Dim> solve_case(const Case<Dim>& analysis, const Progress& progress = {}) {
  return solve_case(analysis, read_mesh(analysis, progress), progress);
}

/// Largest resident memory of this process so far [MiB].
double peak_memory_mb();

}  // namespace efree
