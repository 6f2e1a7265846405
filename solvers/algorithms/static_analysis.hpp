// SPDX-License-Identifier: GPL-3.0-or-later
/// Static linear elasticity on any basis.
#pragma once

#include "efree/geometry/mesh/locator.hpp"
#include "efree/solvers/algorithms/functional.hpp"
#include "efree/solvers/equations/equilibrium.hpp"

#include <memory>
#include <optional>
#include <vector>

namespace efree {

/// Coefficients and what is derived at the quadrature points.
template <int Dim> struct Solution {
  Points<Dim> coefficients;    ///< Dim x N; not nodal displacements: use interpolate(shape, coefficients)
  VoigtPoints<Dim> strain;     ///< at quadrature points, engineering shear; in plane stress with that across the plane
  VoigtPoints<Dim> stress;     ///< at quadrature points
  double strain_energy = 0.0;  ///< [force * length], in the plane per thickness
};

/// Strains, stresses and energy of the field with these coefficients (Dim x N). Throws InputError for moduli out of
/// range, NumericalError if a value is not finite.
template <int Dim>
Solution<Dim> evaluate(const Approximation<Dim>& approximation, const ElasticModel& model, Points<Dim> coefficients);
/// The same of several fields, bitwise as one by one, in less time. Throws likewise.
template <int Dim> std::vector<Solution<Dim>> evaluate_all(const Approximation<Dim>& approximation,
                                                           const ElasticModel& model,
                                                           std::vector<Points<Dim>> coefficients);

/// Equilibrium by one linear step: assembles and factors once, then solves any number of load cases. Regions of a mesh
/// parted by cut_regions are tied to each other where they touch, by Nitsche.
template <int Dim> class ElasticSolver {
 public:
  /// Keeps references to the approximation. Throws InputError like Equilibrium; NumericalError if the matrix cannot be
  /// factored. Stages: assembly, solve (factorisation).
  ElasticSolver(const Approximation<Dim>& approximation, const ElasticModel& model,
                const std::vector<DisplacementCondition<Dim>>& conditions, const Monitor& monitor = {});
  ~ElasticSolver();
  ElasticSolver(ElasticSolver&&) noexcept;

  /// One load case with the prescribed displacements. Throws NumericalError if the solution lives on deformations that
  /// the quadrature does not see (too few points per node), or if the materials are not linear at its strains.
  Solution<Dim> solve(const Loads<Dim>& loads) const;
  /// Any number of them, which take less time together than one by one. Throws likewise.
  std::vector<Solution<Dim>> solve_all(const std::vector<Loads<Dim>>& cases) const;
  /// Of finite elements: the displacements of the dual solutions of functionals (DualSolution), by the same factor.
  /// Throws InputError on other bases.
  std::vector<Points<Dim>> duals(const std::vector<Functional<Dim>>& functionals) const;
  /// Likewise, the functional for the solution u under these loads.
  double value(const Functional<Dim>& functional, const Points<Dim>& u, const Loads<Dim>& loads) const;
  /// Of each solution, by part with displacement conditions: the force and moment by which it holds the body
  /// (Equilibrium::reactions).
  std::vector<Resultants<Dim>> reactions(const std::vector<const Solution<Dim>*>& solutions,
                                         const std::vector<Loads<Dim>>& cases) const;
  Index num_unknowns() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Displacement on the fine mesh at the degrees of freedom of approximation.space, strain and stress at its places.
/// These are recovered: linear least-squares fits of the quadrature-point values around each node, with half of their
/// slopes blended by the basis. Linear fields at the quadrature points are reproduced. They jump between regions: at a
/// place the points of its own region count alone, and where these are too few for a plane the value is their mean.
/// Throws NumericalError if a recovered value is not finite.
template <int Dim> struct Fields {
  Points<Dim> displacement;         ///< Dim x space.size()
  VoigtPoints<Dim> strain, stress;  ///< columns: space.num_places()
};
/// The fits as sums over quadrature points, for any number of solutions on one approximation.
template <int Dim> struct RecoveryFits {
  SparseRows values;   ///< nodes (of finite elements: places) x quadrature points: the value of the fit at the node
  Points<Dim> slopes;  ///< by entry of `values`: the same of its derivatives; empty for finite elements
};
/// Those of an approximation.
template <int Dim> RecoveryFits<Dim> recovery_fits(const Approximation<Dim>& approximation);
/// Of a solution, from its quadrature points; with the fits of this approximation where there are several.
template <int Dim> Fields<Dim> recover_fields(const Approximation<Dim>& approximation, const Solution<Dim>& solution);
/// The same with fits that there are already.
template <int Dim> Fields<Dim> recover_fields(const Approximation<Dim>& approximation, const Solution<Dim>& solution,
                                              const RecoveryFits<Dim>& fits);

/// Fields at one point.
template <int Dim> struct ProbeValues {
  Vec<Dim> displacement;
  Voigt<Dim> strain, stress;
};
/// There; a Locator finds many points.
template <int Dim>
ProbeValues<Dim> probe(const FineSpace<Dim>& space, const Fields<Dim>& fields, const Location<Dim>& there);
/// At a point. Throws InputError (with the nearest vertex of the body) if it lies outside.
template <int Dim> ProbeValues<Dim> probe(const FineSpace<Dim>& space, const Fields<Dim>& fields, const Vec<Dim>& at) {
  return probe(space, fields, locate(space.mesh(), at));
}

/// Relative errors against an exact solution, integrated on the fine mesh. What is not given exactly has no error.
struct Errors {
  std::optional<double> l2_displacement;        ///< |u - u_h| / |u|
  std::optional<double> energy_norm;            ///< from the gradients of u_h on the fine cells
  std::optional<double> energy_norm_recovered;  ///< from the recovered stress
};
/// A closed form to compare with.
template <int Dim> struct ExactSolution {
  VectorField<Dim> displacement;  ///< may be empty
  VoigtField<Dim> stress;         ///< may be empty
};
/// Of fields on the space of an approximation.
template <int Dim> Errors errors_against(const Approximation<Dim>& approximation, const Fields<Dim>& fields,
                                         const Materials<Dim>& materials, const ExactSolution<Dim>& exact);

/// Error of the displacement against the exact solution, in the energy norm, as far as the recovered stresses are
/// exact: the distance between these and those of the displacement's gradients, on the fine mesh (Zienkiewicz & Zhu
/// 1987). For finite elements it tends to the true error as the mesh is refined.
struct RecoveryError {
  double relative;  ///< of the body; 0 without any stress
  Vector squares;   ///< by cell: square of the distance [force * length]
};
/// Of fields that were recovered.
template <int Dim> RecoveryError recovery_error(const Approximation<Dim>& approximation, const Fields<Dim>& fields,
                                                const Materials<Dim>& materials);
/// The same of several, in less time.
template <int Dim> std::vector<RecoveryError> recovery_errors(const Approximation<Dim>& approximation,
                                                              const std::vector<const Fields<Dim>*>& fields,
                                                              const Materials<Dim>& materials);

/// The same of stresses at the quadrature points of finite elements (Solution::stress), whatever materials answered
/// with them: their interpolation over the cell against what was recovered from them, in the energy norm of the
/// materials at rest, relative to the stresses themselves.
template <int Dim> RecoveryError recovery_error_of_points(const Approximation<Dim>& elements,
                                                          const VoigtPoints<Dim>& stress, const Fields<Dim>& fields,
                                                          const Materials<Dim>& materials);

/// By cell: the integral of the work of the difference between recovered stress and that of the displacement's
/// gradients of `a` on the strains that belong to the same difference of `b` [force * length]. With a = b these are the
/// squares of recovery_error; with the dual solution of a functional as b the sum is what the mesh leaves of that
/// functional, with its sign.
template <int Dim> Vector recovery_products(const Approximation<Dim>& approximation, const Fields<Dim>& a,
                                            const Fields<Dim>& b, const Materials<Dim>& materials);

/// What a mesh leaves of a functional, from the recovered fields of the finite elements' solution and of the
/// functional's dual one, as an absolute value: the sum of recovery_products, for quadratic cells twice that, but at
/// least a tenth of what these products could be in each cell (so that what cancels by chance is not taken for none).
/// Chosen on bench_dual: for linear cells 0.67 to 2 times the true error in four cases of five, for quadratic ones 0.5
/// to 2 in three of four.
template <int Dim> double functional_error(const Approximation<Dim>& elements, const Fields<Dim>& u,
                                           const Fields<Dim>& z, const Materials<Dim>& materials);

/// In each cell around a place of the space (of its region), at the degrees of freedom of the cell: recovered stress
/// less that of the displacement's gradients.
template <int Dim> std::vector<VoigtPoints<Dim>> stress_differences(const Approximation<Dim>& approximation,
                                                                    const Fields<Dim>& fields,
                                                                    const Materials<Dim>& materials, Index place);

/// Relative distance in the energy norm of fields with a pressure of their own, as averaged dilatations (B-bar) give
/// it, from a displacement of finite elements: of the deviators of the strains, and of the pressures. What the
/// pointwise divergence of the displacement would cost is not in it: towards nu = 1/2 it grows beyond bounds and means
/// nothing. `fields` and `displacement` at the degrees of freedom of elements.space; 0 without any
/// stress.
template <int Dim> double mixed_distance(const Approximation<Dim>& elements, const Points<Dim>& displacement,
                                         const Fields<Dim>& fields, const Materials<Dim>& materials);

}  // namespace efree
