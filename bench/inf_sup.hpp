// SPDX-License-Identifier: GPL-3.0-or-later
/// Stiffness without rigid motions, and the inf-sup value of averaged dilatations; tests and studies share them.
#pragma once

#include "efree/assembly/materials.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/quadrature/approximation.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include <cmath>

namespace efree::bench {

/// All entries of the stiffness.
template <int Dim> Matrix dense_stiffness(const Discretization<Dim>& discretization, const Materials<Dim>& materials) {
  const SymmetricMatrix full =
      stiffness_matrix(discretization, materials.tangents(discretization)).template selfadjointView<Eigen::Lower>();
  return Matrix(full);
}

/// Orthonormal basis of the coefficients that hold no rigid motion (order 1 reproduces those from nodal positions).
template <int Dim> Matrix without_rigid_motions(const Points<Dim>& nodes) {
  constexpr int motions = Dim * (Dim + 1) / 2;
  Matrix rigid = Matrix::Zero(Dim * nodes.cols(), motions);
  for (Index a = 0; a < nodes.cols(); ++a) {
    int motion = Dim;
    for (int i = 0; i < Dim; ++i) {
      rigid(Dim * a + i, i) = 1.0;
      for (int j = 0; j < i; ++j, ++motion) {
        rigid(Dim * a + i, motion) = nodes(j, a);
        rigid(Dim * a + j, motion) = -nodes(i, a);
      }
    }
  }
  const Matrix Q = Eigen::HouseholderQR<Matrix>(rigid).householderQ();
  return Q.rightCols(Q.cols() - motions);
}

/// Stiffness on the space that `basis` spans.
template <int Dim> Matrix reduced_stiffness(const Discretization<Dim>& discretization, const Materials<Dim>& materials,
                                            const Matrix& basis) {
  return basis.transpose() * dense_stiffness(discretization, materials) * basis;
}

/// Smallest of int p div u over the norms of p in L2 and of u in the energy of the projected gradients, p made of
/// Approximation::pressures.
template <int Dim> double inf_sup(const Approximation<Dim>& approximation, const Materials<Dim>& materials) {
  const Matrix basis = without_rigid_motions<Dim>(approximation.nodes);
  const Discretization<Dim>& pressures = approximation.dilatation;
  Matrix divergence = Matrix::Zero(pressures.size(), Dim * approximation.nodes.cols());
  for (Index j = 0; j < pressures.size(); ++j) {
    const auto row = pressures.shape.row(j);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      divergence.template block<1, Dim>(j, Dim * row.nodes[k]) =
          std::sqrt(pressures.weights[j]) * row.dN[k].transpose();
  }
  const Matrix reduced = divergence * basis;
  const Matrix schur =
      reduced * reduced_stiffness(approximation.quadrature, materials, basis).llt().solve(reduced.transpose());
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix>(schur, Eigen::EigenvaluesOnly).eigenvalues().minCoeff());
}

}  // namespace efree::bench
