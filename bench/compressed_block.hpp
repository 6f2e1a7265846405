// SPDX-License-Identifier: GPL-3.0-or-later
/// A block that is squeezed until its free surface wrinkles (Biot 1963); tests and the study share it.
#pragma once

#include "efree/analysis/prepare.hpp"
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <complex>

namespace efree::bench {

/// Neo-Hookean, E = 1, plane strain, 2 x 1: left, right and bottom slide, the top is free. What is prescribed at a time
/// is the stretch 1 - time between the sides. The deformation is homogeneous and so exact on any functions.
struct CompressedBlock {
  static constexpr double width = 2.0, height = 1.0;
  /// Stretch at which the surface of an incompressible half-space has its first zero eigenvalue, for waves of any
  /// length: root of l^6 + l^4 + 3 l^2 = 1. A block that rests on a plane gets there with its shortest waves.
  static constexpr double incompressible = 0.543689;

  double nu = 0.4999;

  static FineMesh<2> mesh(double size) { return triangulate(shapes::rectangle(0, 0, width, height), {.size = size}); }

  /// Dilatations where the defaults have them.
  Approximation<2> approximation(const FineMesh<2>& mesh, ApproximationOptions options) const {
    if (options.dilatation == Dilatation::automatic)
      options.dilatation =
          averaged_if(incompressibility<2>(model(options.kind), mesh) > bearable_incompressibility(options.kind));
    return approximate(mesh, options);
  }
  ElasticModel model(BasisKind kind) const {
    return {.material = NeoHookean({.E = 1.0, .nu = nu}),
            .plane = Plane::strain,
            .essential = kind == BasisKind::mls ? Essential::nitsche : Essential::strong};
  }
  static Program<2> program() {
    return {[](double time) -> std::vector<DisplacementCondition<2>> {
              return {symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), {"right", {}, [time](const Vec<2>&) {
                                                                                 return -time * width;
                                                                               }}};
            },
            [](double) { return Loads<2>{}; }};
  }

  /// Stretch across, which leaves no stress there: mu (b - 1/b) + lambda ln(l b) / b = 0.
  double across(double stretch) const {
    const auto [lambda, mu, kappa] = ElasticModuli{.E = 1.0, .nu = nu}.at(Vec<3>::Zero());
    double b = 1.0 / stretch;
    for (int k = 0; k < 50; ++k)
      b -= (mu * (b * b - 1.0) + lambda * std::log(stretch * b)) / (2.0 * mu * b + lambda / b);
    return b;
  }
  /// The homogeneous state.
  State at(const NonlinearEquilibrium<2>& equations, double stretch) const {
    State state = equations.under(1.0 - stretch, equations.rest());
    const Vec<2> H(stretch - 1.0, across(stretch) - 1.0);
    const Points<2> u = H.asDiagonal() * equations.approximation().nodes;
    state.u = u.reshaped();
    return state;
  }

  /// The stretch of the first zero eigenvalue of a half-space of this material: where the impedance of its surface,
  /// tractions over displacements of waves a exp(i x + s y) that decay downwards, is singular.
  double critical() const {
    double stable = 1.0, unstable = 0.98;
    while (impedance(unstable) > 0.0) stable = unstable, unstable -= 0.02;
    while (stable - unstable > 1e-7) {
      const double middle = 0.5 * (stable + unstable);
      (impedance(middle) > 0.0 ? stable : unstable) = middle;
    }
    return stable;
  }

  /// Directions in which the energy of the homogeneous state falls.
  static Index falls(const NonlinearEquilibrium<2>& equations, Cholesky& solver, const State& state) {
    SymmetricMatrix K;
    equations.tangent(state, K);
    solver.analyse(K, equations.node_of_unknowns());
    solver.factorize(K);
    return solver.negative_pivots();
  }
  /// The stretch of the first zero eigenvalue on the way down from 1, by steps of 0.04 and then bisection; 0 if there
  /// is none above 0.3.
  double first_zero(const Approximation<2>& approximation, BasisKind kind = BasisKind::mls) const {
    const NonlinearEquilibrium<2> equations(approximation, model(kind), program());
    Cholesky solver;
    double stable = 1.0, unstable = 0.96;
    while (falls(equations, solver, at(equations, unstable)) == 0) {
      stable = unstable;
      unstable -= 0.04;
      if (unstable < 0.3) return 0.0;
    }
    while (stable - unstable > 4e-4) {
      const double middle = 0.5 * (stable + unstable);
      (falls(equations, solver, at(equations, middle)) == 0 ? stable : unstable) = middle;
    }
    return 0.5 * (stable + unstable);
  }

 private:
  /// Its smallest eigenvalue.
  double impedance(double stretch) const {
    const Mat<3> F = Vec<3>(stretch, across(stretch), 1.0).asDiagonal();
    const auto A = respond(NeoHookean({.E = 1.0, .nu = nu}), {Points<3>::Zero(3, 1), F.reshaped(), Matrix(0, 1)}, true);
    const auto block = [&](int J, int L) {
      Mat<2> result;
      for (int i = 0; i < 2; ++i)
        for (int k = 0; k < 2; ++k) result(i, k) = A.tangent_at(0)(3 * J + i, 3 * L + k);
      return result;
    };
    const Mat<2> Q = block(0, 0), R = block(0, 1), T = block(1, 1);
    Eigen::Matrix4cd M = Eigen::Matrix4cd::Zero();  // -Q a + i s (R + R^T) a + s^2 T a = 0
    M.topRightCorner<2, 2>().setIdentity();
    M.bottomLeftCorner<2, 2>() = (T.inverse() * Q).cast<std::complex<double>>();
    M.bottomRightCorner<2, 2>() = std::complex<double>(0, -1) * (T.inverse() * (R + R.transpose()));
    const Eigen::ComplexEigenSolver<Eigen::Matrix4cd> waves(M);
    Eigen::Matrix2cd u, t;
    for (int k = 0, found = 0; k < 4 && found < 2; ++k) {
      const auto s = waves.eigenvalues()[k];
      if (s.real() <= 0.0) continue;
      u.col(found) = waves.eigenvectors().col(k).head<2>();
      t.col(found) = std::complex<double>(0, 1) * (R.transpose() * u.col(found)) + s * (T * u.col(found));
      ++found;
    }
    const Eigen::Matrix2cd Z = t * u.inverse();
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix2cd>(0.5 * (Z + Z.adjoint()), Eigen::EigenvaluesOnly)
        .eigenvalues()[0];
  }
};

}  // namespace efree::bench
