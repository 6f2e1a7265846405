// SPDX-License-Identifier: GPL-3.0-or-later
/// What an analysis finds: fields, the numbers that were asked for, and their errors.
#pragma once

#include "efree/analysis/prepare.hpp"
#include "efree/analysis/steps.hpp"
#include "efree/assembly/loads.hpp"

#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// One mesh, grid of cells or load path that was tried on the way to an accuracy.
struct Attempt {
  double size;     ///< of the fine mesh, asked for; 0: that of the file; on cells their edges
  Index cells;     ///< of it
  int degree;      ///< of its elements
  double error;    ///< relative, in the energy norm, in all; of load paths PathErrors::largest
  double seconds;  ///< wall clock
  /// Error over what was asked for, the largest of all that was: as a root for probes and reactions, whose errors
  /// behave like squares of those in the energy norm. 1 or less: reached. 0 without an accuracy.
  double excess = 0.0;
  double spacing = 0.0;  ///< of the cloud of a load path; 0: elements, or no load path
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

/// The largest and the smallest value of a field.
template <int Dim> struct FieldRange {
  std::string of;  ///< "displacement_x", "strain_xx", "stress_xx", ..., "principal_stress"
  double most, least;
  Vec<Dim> most_at, least_at;
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
                       ///< same as `cloud`; without a cloud of linear elements; 0: finite elements solved at once
  double mesh;         ///< of these finite elements, by recovery; on cells of their grid, by coarser ones
  int corrections;     ///< iterations that led to the answer
  /// Of the faceted approximation of curved boundaries: the root of the relative change of the potential energy if the
  /// boundary moves from the facets to the true surface (ShapeDerivative); 0 where nothing is known of that.
  double geometry = 0.0;
  double total() const { return std::hypot(cloud, mesh, geometry); }
};

/// How far a cloud's forces and displacements are, at the end of its steps, from those of the finite elements of its
/// fine mesh: by name, the length of the difference over that of theirs, or over a hundredth of the largest of their
/// kind if that is more.
struct CloudAlone {
  std::map<std::string, double> reactions, probes;
};

/// Estimated errors of a load path, relative, by a coarser path that stops at the same times: the largest difference on
/// the way, over the largest value there, times 1 / (coarser^1.5 - 1), as if errors fell with the spacing to the 1.5
/// (Richardson 1911); with a third path as docs/theory.md says. By arc length two paths have no times in common: then
/// the distance from each step to the nearest point of the coarser path, in the plane of the time and the value, each
/// over its largest value. Where materials flow those by the size of steps are added, as if they fell with the first
/// power of it: by the differences between the coarser path and the same with half as many steps. The errors of a mesh
/// that both paths share are not in it.
struct PathErrors {
  double coarser = 0.0;     ///< spacing of the coarser path over that of this one, by their numbers of nodes
  double until = 0.0;       ///< time that both reached
  double work = 0.0;        ///< of the energy stored and dissipated
  double dissipated = 0.0;  ///< of what is dissipated, over that; not among `largest`
  double space = 0.0;       ///< the largest error of a value without those by the size of steps
  double steps = 0.0;       ///< the largest error of a value by the size of steps; in elastic bodies there is none
  /// Of a limit load where loads are proportional to the time: where a path stopped; by arc length the first largest
  /// time.
  std::optional<double> limit{};
  /// Of the stresses at the end: the root mean square over the body of the differences, over that of the stresses.
  /// Unknown unless both paths end at the same time.
  std::optional<double> stress{};
  /// By name; of a hundredth of the largest of their kind if that is more, and of forces of their moment over the
  /// diagonal of the body's box.
  std::map<std::string, double> reactions, probes;

  /// The largest error of a value (of all but the stresses), and which value, for people.
  std::pair<double, std::string> largest() const;
};

/// What holds a body and what loads it.
template <int Dim> struct Balance {
  /// By part with displacement conditions: the force and moment by which it holds the body, from the equilibrium of the
  /// problem that the answer solves.
  Resultants<Dim> reactions;
  std::vector<AppliedLoad<Dim>> loads;  ///< each by itself
  double error = 0.0;                   ///< of both together, relative (imbalance); more than rounding is a fault
  double free_work = 0.0;               ///< of forces that nothing holds, over that of all: what corrections leave
};

/// A number or a vector, and its absolute error, by component.
template <class Value> struct WithError { Value value, error; };
/// Results for the true surface of the body in place of its facets: with their changes to first order in the distance
/// between both (ShapeDerivative). Errors are those of the cells and of the higher orders.
template <int Dim> struct OnSurface {
  /// [force * length]. Unknown where loads act and displacements other than zero are prescribed, and with springs.
  std::optional<WithError<double>> strain_energy{};
  /// Displacements and forces, where errors of probes and reactions are estimated.
  std::map<std::string, WithError<Vec<Dim>>> probes{}, reactions{};
};

/// What was found for one load case.
template <int Dim> struct Answer {
  Solution<Dim> solution;  ///< on cells the strain energy only
  /// None for finite elements, nor where averaged dilatations lack memory for them.
  std::optional<Estimates> estimates;
  Fields<Dim> fields;                                            ///< displacements, recovered strains and stresses
  std::vector<std::pair<std::string, ProbeValues<Dim>>> probes;  ///< in the order of the settings
  /// Absolute errors of the components of the probes' displacements, by name, where they are known.
  std::map<std::string, Vec<Dim>> probe_errors;
  std::vector<Extreme<Dim>> extremes;          ///< largest displacement and von Mises stress
  std::vector<ReactionResult<Dim>> reactions;  ///< in the order of the settings, where the finite elements are known
  Balance<Dim> balance;
  /// Where facets are no farther from the true surface than a twentieth of walls and radii of curvature.
  std::optional<OnSurface<Dim>> on_surface{};
};

/// What an analysis found; of several load cases it is the answer to the first.
template <int Dim> struct Result : Answer<Dim> {
  std::shared_ptr<const FineMesh<Dim>> mesh;  ///< the fine mesh, without what was left out
  ElasticModel model;                         ///< with the materials of all regions
  Approximation<Dim> approximation;           ///< shares the mesh
  /// Finite elements of the fine mesh that `solution` belongs to if it is corrected; else it is of `approximation`.
  std::optional<Approximation<Dim>> elements;
  /// What `solution` and `fields` belong to.
  const Approximation<Dim>& basis() const { return elements ? *elements : approximation; }

  std::optional<Errors> errors;   ///< if an exact solution is known
  std::vector<Answer<Dim>> more;  ///< answers to the load cases after the first, in their order
  /// Of an analysis through time only if it is corrected. By cell of the mesh: what recovered stresses are off those of
  /// the displacement, in the energy norm, relative to the mean energy density of the body. The root of its mean square
  /// over the volume is the error of the body in all.
  Vector error_density;
  Matrix offsets;  ///< of the mesh's facets from the true surface (facet_offsets); empty: none are known
  std::vector<BoundaryPart> parts;                        ///< of the boundary
  std::vector<std::pair<std::string, Reported>> reports;  ///< of the geometry

  /// If an accuracy was asked for, and of load paths that leave their functions open: in order. The answer is
  /// that of the smallest error, of load paths the last.
  std::vector<Attempt> attempts;

  /// Of an analysis through time: every step; then the fields are those of the last.
  std::vector<HistoryStep<Dim>> history;
  /// What the materials remember at its end, by name ("equivalent_plastic_strain", "plastic_strain", ...): rows as
  /// HistoryPart says, columns as those of stresses. Zero where a region has no such thing.
  std::vector<std::pair<std::string, Matrix>> remembered;
  std::string stopped;  ///< why it did not come to its end; empty if it did
  /// Largest distance of the cloud from displacements that are prescribed, at the end, over the largest displacement.
  double gap = 0.0;
  /// TimeSettings::elastic_range of its settings, or, where loads turn within its steps, that to follow them by.
  double elastic_range = 1.0;
  std::optional<CloudAlone> cloud_alone{};
  std::optional<PathErrors> path_errors{};  ///< where `estimates` are unknown, and a coarser path is known
  /// If the body was not stable on its way: how it gave way at the first step at which it was not, at the degrees of
  /// freedom of the approximation's space (softest_mode).
  Points<Dim> instability{};

  /// What was modelled: never automatic.
  Regime regime = Regime::linear;
  std::vector<LinearCheck> linear_checks;  ///< with Regime::automatic, in the order of time

  std::vector<std::string> warnings;  ///< what makes the numbers doubtful
  std::string refusal;                ///< why they are no answer; empty if they are one

  /// Wall-clock seconds: mesh, cloud, weights, basis, quadrature, assembly, solve, correction, coarser cloud (errors of
  /// paths), duals (errors of probes, reactions, extremes), output (recovery, errors, probes).
  StageTimes times;
  double cpu_seconds = 0.0;  ///< of all threads, from mesh to solve
};

/// The answers to all load cases.
template <int Dim> std::vector<Answer<Dim>*> answers_in(Result<Dim>& result) {
  std::vector<Answer<Dim>*> all{&result};
  for (Answer<Dim>& answer : result.more) all.push_back(&answer);
  return all;
}

/// Range of every component of displacement, strain and stress, and of the principal stresses.
template <int Dim> std::vector<FieldRange<Dim>> field_ranges(const FineSpace<Dim>& space, const Fields<Dim>& fields);

/// Names of the components of a strain or stress in Voigt order.
template <int Dim> std::vector<const char*> component_names(bool axisymmetric) {
  if (Dim == 3) return {"xx", "yy", "zz", "yz", "xz", "xy"};
  if (axisymmetric) return {"rr", "zz", "tt", "rz"};
  return {"xx", "yy", "zz", "xy"};
}

/// The largest and the smallest principal stress [stress].
template <int Dim> std::pair<double, double> principal_stresses(const Voigt<Dim>& stress);

/// von Mises stress at the places of the space (FineSpace::num_places).
template <int Dim> Vector von_mises_at_places(const Fields<Dim>& fields);

}  // namespace efree
