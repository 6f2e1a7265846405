// SPDX-License-Identifier: GPL-3.0-or-later
/// What the tangent of few quadrature points sees of the functions, at rest, at large strains and after yield; tests
/// and the study share it.
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/equations/locking.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"

#include <Eigen/Eigenvalues>

#include <array>

namespace efree::bench {

/// A homogeneous state of a block 2 x 1 in plane strain, E = 1, between stiff springs on three sides, which count alike
/// for all quadratures; the top is free.
struct StrainedBlock {
  const char* name;
  SharedMaterial material;
  Vec<2> strains;  ///< stretch - 1, along x and y

  static std::array<StrainedBlock, 6> all() {
    const auto rubber = [](const char* name, double nu, double stretch) {
      const double shape = nu > 0.4 ? 1.0 / stretch : std::pow(stretch, -nu / (1.0 - nu));
      return StrainedBlock{name, NeoHookean({.E = 1.0, .nu = nu}), {stretch - 1.0, shape - 1.0}};
    };
    return {
        rubber("at rest", 0.3, 1.0),
        rubber("stretched to 2", 0.3, 2.0),
        rubber("squeezed to 0.7", 0.3, 0.7),
        rubber("nearly incompressible stretched to 2", 0.4999, 2.0),
        rubber("nearly incompressible squeezed to 0.7", 0.4999, 0.7),
        {"yielding", J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = Hardening::linear(0.002, 0.01)}), {0.02, -0.02}}};
  }

  static FineMesh<2> mesh(double size) { return triangulate(shapes::rectangle(0, 0, 2, 1), {.size = size}); }
  ElasticModel model() const { return {.material = material, .plane = Plane::strain, .essential = Essential::nitsche}; }
  /// Dilatations where the defaults have them.
  Approximation<2> approximation(const FineMesh<2>& mesh, ApproximationOptions options) const {
    if (options.dilatation == Dilatation::automatic)
      options.dilatation =
          averaged_if(flows(model()) || incompressibility<2>(model(), mesh) > bearable_incompressibility(options.kind));
    return approximate(mesh, options);
  }
  Matrix tangent(const Approximation<2>& approximation) const {
    std::vector<DisplacementCondition<2>> springs;
    for (const char* side : {"left", "right", "bottom"}) {
      springs.push_back(symmetry_plane<2>(side));
      springs.back().stiffness = [](const Vec<2>&) { return 100.0; };
    }
    const NonlinearEquilibrium<2> equations(approximation, model(), Program<2>::grows(springs));
    State state = equations.under(1.0, equations.rest());
    const Points<2> u = strains.asDiagonal() * approximation.nodes;
    state.u = u.reshaped();
    SymmetricMatrix K;
    equations.tangent(state, K);
    return SymmetricMatrix(K.selfadjointView<Eigen::Lower>());
  }
};

/// Eigenvalues of the tangent K u = lambda S u, S the elastic stiffness at rest (nu = 0.3) of every fine cell: how
/// stiff the body is against the deformations of its functions.
struct Coercivity {
  Vector eigenvalues;  ///< ascending
  double every_cell;   ///< the smallest one where K is integrated on every fine cell, with averages as the other has
  double ratio;        ///< M/N
  Index nodes;

  Coercivity(const StrainedBlock& block, const FineMesh<2>& mesh, const ApproximationOptions& options) {
    const auto approximation = block.approximation(mesh, options);
    ApproximationOptions every = options;
    every.secondary = SecondaryKind::full;
    const StrainedBlock rest{"", LinearElastic(1.0, 0.3), {0.0, 0.0}};
    const Matrix S = rest.tangent(rest.approximation(mesh, every));
    const auto against_rest = [&](const Matrix& K) -> Vector {
      return Eigen::GeneralizedSelfAdjointEigenSolver<Matrix>(K, S, Eigen::EigenvaluesOnly).eigenvalues();
    };
    eigenvalues = against_rest(block.tangent(approximation));
    every_cell = against_rest(block.tangent(block.approximation(mesh, every)))[0];
    ratio = approximation.ratio();
    nodes = approximation.nodes.cols();
  }
  /// The share of the least stiffness that the points see.
  double seen() const { return eigenvalues[0] / every_cell; }
  /// Deformations that they do not see.
  Index zero() const { return (eigenvalues.array().abs() < 1e-8).count(); }
  /// Those along which the energy falls.
  Index negative() const { return (eigenvalues.array() <= -1e-8).count(); }
};

}  // namespace efree::bench
