// SPDX-License-Identifier: GPL-3.0-or-later
/// Strain, its adjoint and the stiffness matrix on any discretization. Degree of freedom = Dim * node + component.
#pragma once

#include "efree/quadrature/discretization.hpp"

namespace efree {

/// Symmetric matrix, lower triangle only, sorted columns.
using SymmetricMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;

/// B: Voigt strain (engineering shear) of a node's displacement, from its gradient. B(n)^T sigma = sigma n for a normal
/// n.
template <int Dim> Eigen::Matrix<double, voigt_size<Dim>, Dim> strain_matrix(const Vec<Dim>& dN);

/// Strain at the quadrature points of the field with coefficients U (Dim x N).
template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U);

/// Adjoint of `strain`: f (Dim x N) with <f, U> = sum_K w_K stress_K . strain(U)_K.
template <int Dim>
Points<Dim> internal_force(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress);

/// K = sum_K w_K B_K^T C B_K, (Dim N)^2. One thread owns one row, so the sums do not depend on the threads.
template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const VoigtMatrix<Dim>& C);
/// The same with a C for every region.
template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const std::vector<VoigtMatrix<Dim>>& C);

}  // namespace efree
