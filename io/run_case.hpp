// SPDX-License-Identifier: GPL-3.0-or-later
/// One case from mesh to fields.
#pragma once

#include "efree/io/case_file.hpp"
#include "efree/solvers/cell_solver.hpp"

#include <cmath>
#include <functional>
#include <map>
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
  double size = 0.0;                      ///< edges it was made with; the longest of a file with sizes of its own
  std::vector<SharedMaterial> materials;  ///< by region of the mesh
  std::shared_ptr<const LabelImage<Dim>> image;  ///< whose lattice the mesh was cut out of; else none
  std::map<Label, std::string> region_of_label;  ///< of the image: names of regions
  std::string open_interface;  ///< part along which regions are not tied; empty: tied wherever they touch
  std::vector<Part> parts;     ///< in the order of the case
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry
  std::vector<std::string> remarks;                       ///< what to tell the user: the same in words, the parts
  double seconds = 0.0, cpu_seconds = 0.0;
};

/// One mesh, or grid of cells, that was tried on the way to an accuracy.
struct Attempt {
  double size;     ///< of the fine mesh, asked for; 0: that of the file; on cells their edges
  Index cells;     ///< of it
  int degree;      ///< of its elements
  double error;    ///< relative, in the energy norm, in all
  double seconds;  ///< wall clock
  /// Error over what was asked for, the largest of all that was: as a root for probes and reactions, whose errors
  /// behave like squares of those in the energy norm. 1 or less: reached. 0 without an accuracy.
  double excess = 0.0;
};

/// The size of an error relative to that of the value; 0 without an error.
template <int Dim> double relative_error(const Vec<Dim>& value, const Vec<Dim>& error) {
  return error.norm() > 0.0 ? error.norm() / value.norm() : 0.0;
}

/// The force by which what is prescribed on a part holds the body [force; in the plane per thickness].
template <int Dim> struct ReactionResult {
  std::string name;
  Vec<Dim> force, error;  ///< error: of each component, absolute
};

/// The largest value of a field.
template <int Dim> struct Extreme {
  std::string of;  ///< "displacement" or "von_mises"
  double value;
  Vec<Dim> at;
  Index place;                  ///< of the space of the fields; of displacements a degree of freedom
  std::optional<double> error;  ///< absolute, where it is known
};

/// Relative errors in the energy norm.
struct Estimates {
  double cloud;        ///< of the answer, against the finite elements of the fine mesh; on cells, of the iterations
  double uncorrected;  ///< of the cloud's own answer, against them (averaged dilatations: mixed_distance); on cells the
                       ///< same as `cloud`; without a cloud of linear elements
  double mesh;         ///< of these finite elements, by recovery; on cells of their grid, by coarser ones
  int corrections;     ///< iterations that led to the answer
  double total() const { return std::hypot(cloud, mesh); }
};

template <int Dim> struct CaseResult {
  std::shared_ptr<const FineMesh<Dim>> mesh;
  ElasticModel model;                ///< with the materials of all regions
  Approximation<Dim> approximation;  ///< refers to *mesh
  /// Finite elements of the fine mesh that `solution` belongs to if it is corrected; else it is of `approximation`.
  std::optional<Approximation<Dim>> elements;
  Solution<Dim> solution;             ///< on cells the strain energy only
  std::optional<CellSolution> cells;  ///< if the case was solved on cells; then `approximation` is a space only
  /// None for finite elements, nor where averaged dilatations lack memory for them.
  std::optional<Estimates> estimates;
  Fields<Dim> fields;
  /// What `solution` and `fields` belong to.
  const Approximation<Dim>& basis() const { return elements ? *elements : approximation; }

  std::optional<Errors> errors;                                  ///< if the case knows an exact solution
  std::vector<std::pair<std::string, ProbeValues<Dim>>> probes;  ///< in the order of the case
  /// Absolute errors of the components of the probes' displacements, by name, where they are known.
  std::map<std::string, Vec<Dim>> probe_errors;
  std::vector<ReactionResult<Dim>> reactions;  ///< in the order of the case, where the finite elements are known
  std::vector<Extreme<Dim>> extremes;          ///< that the case asks for
  /// By cell of the mesh: what recovered stresses are off those of the displacement, in the energy norm, relative to
  /// the mean energy density of the body. The root of its mean square over the volume is the error of the body in all.
  Vector error_density;
  std::vector<typename CaseMesh<Dim>::Part> parts;        ///< of the boundary
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry

  /// If an accuracy was asked for, and on cells: in order. The answer is that of the smallest error, on cells the last.
  std::vector<Attempt> attempts;

  std::vector<std::string> warnings;  ///< what makes the numbers doubtful
  std::string refusal;                ///< why they are no answer; empty if they are one

  /// Wall-clock seconds: mesh, cloud, weights, basis, quadrature, assembly, solve, correction, duals (errors of
  /// probes, reactions, extremes), output (recovery, errors, probes, files).
  StageTimes times;
  double cpu_seconds = 0.0;  ///< of all threads, from mesh to solve
};

/// Fine mesh size of the case [length]; 0 leaves it to the file.
template <int Dim> double mesh_size(const Case<Dim>& analysis);

/// Reads or makes the mesh of the case (stage "mesh"), for moving least squares parted along the interfaces between
/// regions; finds its selections, which become named parts of the boundary; and checks that every boundary and every
/// region the case names is there, that every region has a material and every probe lies inside the body. Interfaces
/// between regions belong to no part. Throws InputError beginning with the place in the case file.
template <int Dim> CaseMesh<Dim> read_mesh(const Case<Dim>& analysis, const Monitor& monitor = {});

/// Runs a case on its mesh. The driver does not know which basis it runs on. Throws InputError beginning with the place
/// in the case file (free rigid motion, spacing larger than the body) and NumericalError.
template <int Dim>
CaseResult<Dim> solve_case(const Case<Dim>& analysis, const CaseMesh<Dim>& mesh, const Monitor& monitor = {});
/// The same on the mesh that the case reads or makes; monitor.say hears of what was found on it.
template <int Dim> CaseResult<Dim> solve_case(const Case<Dim>& analysis, const Monitor& monitor = {}) {
  const CaseMesh<Dim> mesh = read_mesh(analysis, monitor);
  if (monitor.say)
    for (const std::string& remark : mesh.remarks) monitor.say(remark);
  return solve_case(analysis, mesh, monitor);
}

/// Runs a case until its estimated error is within three quarters of analysis.accuracy (at corners recovery overlooks
/// up to a quarter of the error), and those of probes and reactions within their goals: corrections (in the plane of
/// linear elements, no cloud is built if none is said) and, where linear cells do not do, quadratic ones, mesh after
/// mesh, as fine as the errors before ask for. A mesh whose size the case says is the only one. Ends with the best
/// answer and a warning if a finer mesh would take more memory than there is or more time than analysis.time_limit
/// leaves. monitor.say hears of every mesh. Throws like read_mesh and solve_case, and InputError without estimates
/// (require_estimates).
template <int Dim> CaseResult<Dim> solve_to_accuracy(const Case<Dim>& analysis, const Monitor& monitor = {});

/// Largest resident memory of this process so far [MiB].
double peak_memory_mb();

}  // namespace efree
