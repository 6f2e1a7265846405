// SPDX-License-Identifier: GPL-3.0-or-later
/// Gradient, its adjoint and the stiffness matrix on any discretization. Degree of freedom = Dim * node + component.
#pragma once

#include "efree/assembly/materials.hpp"
#include "efree/quadrature/discretization.hpp"

namespace efree {

/// Symmetric matrix, lower triangle only, sorted columns.
using SymmetricMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;

/// Gradient at a point of cell c of the field with values u (Dim x space.size()) at the fine degrees of freedom: of the
/// field itself, not projected.
template <int Dim> Gradient<Dim> gradient_at(const FineSpace<Dim>& space, Index c,
                                             const typename FineSpace<Dim>::Barycentric& at, const Points<Dim>& u) {
  const auto dofs = space.cell(c);
  const auto dN = space.gradients(c, at);
  Gradient<Dim> H = Gradient<Dim>::Zero();
  for (std::size_t i = 0; i < dofs.size(); ++i)
    for (int J = 0; J < Dim; ++J) H.template segment<Dim>(Dim * J) += dN(J, static_cast<Index>(i)) * u.col(dofs[i]);
  if constexpr (Dim == 2)
    if (space.axisymmetric()) {
      const auto N = space.values(at);
      double radial = 0.0;
      for (std::size_t i = 0; i < dofs.size(); ++i) radial += N[static_cast<Index>(i)] * u(0, dofs[i]);
      H[4] = radial / space.position(c, at)[0];
    }
  return H;
}
/// Its symmetric part.
template <int Dim> Voigt<Dim> strain_at(const FineSpace<Dim>& space, Index c,
                                        const typename FineSpace<Dim>::Barycentric& at, const Points<Dim>& u) {
  return strain_of<Dim>(gradient_at(space, c, at, u));
}

/// Gradient at the quadrature points of the field with coefficients U (Dim x N).
template <int Dim> Gradients<Dim> gradient(const Discretization<Dim>& discretization, const Points<Dim>& U);
/// Its symmetric part.
template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U);

/// Adjoint of `gradient`: f (Dim x N) with <f, U> = sum_K w_K P_K : gradient(U)_K.
template <int Dim> Points<Dim> internal_force(const Discretization<Dim>& discretization, const Gradients<Dim>& P);

/// Adjoint of `strain`: f (Dim x N) with <f, U> = sum_K w_K stress_K . strain(U)_K.
template <int Dim>
Points<Dim> forces_of_stress(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress);

/// K = sum_K w_K G_K^T A_K G_K, (Dim N)^2, G the gradient and A symmetric. One thread owns one row, so the sums do not
/// depend on the threads.
template <int Dim>
SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization, const PointTangents<Dim>& A);

}  // namespace efree
