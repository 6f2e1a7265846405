// SPDX-License-Identifier: GPL-3.0-or-later
/// From the cloud's answer to that of the finite elements of its fine mesh, and how far apart the two are.
#pragma once

#include "efree/solvers/algorithms/functional.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <memory>
#include <vector>

namespace efree {

/// How far a correction goes.
struct CorrectionOptions {
  int iterations = -1;      ///< this many; -1: as many as `tolerance` takes, at least one, three with B-bar
  double tolerance = 0.01;  ///< relative error in the energy norm that may be left
  int most = 200;           ///< iterations after which it is given up
};

/// A displacement of the finite elements on the fine mesh and what is known of its error. Errors are relative, in the
/// energy norm, against the solution of the finite element problem.
template <int Dim> struct Correction {
  Points<Dim> displacement;    ///< Dim x space.size(), at the fine degrees of freedom
  double strain_energy = 0.0;  ///< of the finite elements [force * length], from u . K u
  double whole = 0.0;          ///< square of what errors are relative to: twice the strain energy of the best answer
  int iterations = 0;          ///< that led to `displacement`
  double start_error = 0.0;    ///< of the displacement it started from
  double error = 0.0;          ///< of `displacement`, estimated
  /// Squared error that each step took off, relative: the best answer in the space of the cloud first, then the
  /// iterations, also those beyond `displacement` that the estimate took. Empty for a sum of other answers.
  std::vector<double> taken;
};

/// Whether the finite elements that a corrector leads to take the mean of the dilatation in each cell: where the
/// approximation averages dilatations (B-bar) and a material is nearly incompressible (nu = 0.49: incompressibility
/// beyond 50). Up to there quadratic elements do not lock as they are, and on smooth solutions they are several times
/// as accurate.
template <int Dim> bool takes_mean_dilatation(const Approximation<Dim>& approximation, const ElasticModel& model);

/// Two-level conjugate gradients on the finite element problem of the fine mesh (deflation; Tang, Nabben, Vuik &
/// Erlangga 2009, A-DEF2). Coarse space: the functions of the cloud, with rotations of its nodes in thin walls, and
/// where these turn out to be too coarse functions of the fine mesh; on quadratic cells in the plane linear elements
/// (of the approximation only the space counts), unless dilatations are averaged. Smoother: a Chebyshev polynomial of
/// symmetric Gauss-Seidel sweeps (Adams, Brezina, Hu & Tuminaro 2003), or one sweep. The problem is that of
/// BasisKind::p1 or p2 (as the space; ApproximationOptions::dilatation where takes_mean_dilatation), conditions set
/// strongly where nodal values can hold them, regions sharing their nodes. Few elements that iterations hardly help are
/// solved directly after some of them. Errors come from what iterations take off (Hestenes & Stiefel 1952), one beyond
/// the answer among them (Strakos & Tichy 2002).
template <int Dim> class Corrector {
 public:
  /// Assembles, and factors the coarse problem (stage correction). Keeps references to the approximation. Throws like
  /// ElasticSolver, and InputError if the approximation averages dilatations (B-bar) in a space of degree 1, where
  /// finite elements lock: see in_quadratic_space.
  Corrector(const Approximation<Dim>& approximation, const ElasticModel& model,
            const std::vector<DisplacementCondition<Dim>>& conditions, const Monitor& monitor = {});
  ~Corrector();
  Corrector(Corrector&&) noexcept;

  /// Starts from the displacement `start` at the fine degrees of freedom, or at the vertices (Dim x space.size() or
  /// mesh.num_vertices(), of the cloud: interpolate(shape, coefficients)). Stage: correction. Throws NumericalError if
  /// the iterations break down or end without reaching the tolerance.
  Correction<Dim> correct(const Points<Dim>& start, const Loads<Dim>& loads, const CorrectionOptions& options = {},
                          const Monitor& monitor = {}) const;
  /// The same for several load cases in less time: several vectors are multiplied by the matrix, swept and solved for
  /// coarsely together, each as alone but for rounding. Of loads that are sums of others so are the answers, and errors
  /// no more than the sums of theirs: only where these are beyond the tolerance are they iterated, too. Takes ten
  /// vectors of the elements for each.
  std::vector<Correction<Dim>> correct_all(const std::vector<Points<Dim>>& starts, const std::vector<Loads<Dim>>& cases,
                                           const CorrectionOptions& options = {}, const Monitor& monitor = {}) const;

  /// The dual solutions of functionals, iterated together from nothing as `correct_all` iterates. Throws like
  /// `correct`; neither is to be called from two threads at once.
  std::vector<DualSolution<Dim>> duals(const std::vector<Functional<Dim>>& functionals,
                                       const CorrectionOptions& options = {}, const Monitor& monitor = {}) const;
  /// The functional for the solution of the finite elements under these loads: that for the displacement u (Dim x
  /// space.size()) near to it, and what the dual displacement z says is left; off by no more than the product of the
  /// errors of u and z.
  double value(const Functional<Dim>& functional, const Points<Dim>& z, const Points<Dim>& u,
               const Loads<Dim>& loads) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace efree
