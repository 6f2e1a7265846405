// SPDX-License-Identifier: GPL-3.0-or-later
/// Strain, its adjoint and the stiffness matrix on any discretization. Degree of freedom = Dim * node + component.
#pragma once

#include "efree/quadrature/discretization.hpp"

#include <algorithm>
#include <vector>

namespace efree {

/// Symmetric matrix, lower triangle only, sorted columns.
using SymmetricMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, Index>;

/// B: Voigt strain (engineering shear) of a node's displacement, from its gradient and (axisymmetric) its value over
/// the radius. B(n)^T sigma = sigma n for a normal n.
template <int Dim, int Normals = Dim>
Eigen::Matrix<double, voigt_size<Dim, Normals>, Dim> strain_matrix(const Vec<Dim>& dN, double hoop = 0.0);
/// The same of the k-th node in a row of projected gradients.
template <int Dim, int Normals>
Eigen::Matrix<double, voigt_size<Dim, Normals>, Dim> strain_matrix(const ShapeRow<Dim>& row, std::size_t k) {
  if constexpr (Normals > Dim)
    return strain_matrix<Dim, Normals>(row.dN[k], row.hoop[k]);
  else
    return strain_matrix<Dim, Normals>(row.dN[k]);
}

/// Strain at a point of cell c of the field with values u (Dim x space.size()) at the fine degrees of freedom: of the
/// field itself, not projected.
template <int Dim, int Normals> Voigt<Dim, Normals> strain_at(const FineSpace<Dim>& space, Index c,
                                                              const typename FineSpace<Dim>::Barycentric& at,
                                                              const Points<Dim>& u) {
  const auto dofs = space.cell(c);
  const auto dN = space.gradients(c, at);
  typename FineSpace<Dim>::CellValues hoop;
  if constexpr (Normals > Dim) hoop = space.values(at) / space.position(c, at)[0];
  Voigt<Dim, Normals> eps = Voigt<Dim, Normals>::Zero();
  for (std::size_t i = 0; i < dofs.size(); ++i)
    eps += strain_matrix<Dim, Normals>(dN.col(i), Normals > Dim ? hoop[i] : 0.0) * u.col(dofs[i]);
  return eps;
}

/// Strain at the quadrature points of the field with coefficients U (Dim x N).
template <int Dim> VoigtPoints<Dim> strain(const Discretization<Dim>& discretization, const Points<Dim>& U);

/// Adjoint of `strain`: f (Dim x N) with <f, U> = sum_K w_K stress_K . strain(U)_K.
template <int Dim>
Points<Dim> internal_force(const Discretization<Dim>& discretization, const VoigtPoints<Dim>& stress);

/// K = sum_K w_K B_K^T C B_K, (Dim N)^2, from a C for every region. One thread owns one row, so the sums do not depend
/// on the threads. Throws InputError if C has not as many rows as the discretization has strains.
template <int Dim, int Size> SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization,
                                                              const std::vector<Eigen::Matrix<double, Size, Size>>& C);
/// The same with one C everywhere.
template <int Dim, int Size> SymmetricMatrix stiffness_matrix(const Discretization<Dim>& discretization,
                                                              const Eigen::Matrix<double, Size, Size>& C) {
  const auto regions = 1 + std::ranges::max(discretization.region);
  return stiffness_matrix(discretization, std::vector<Eigen::Matrix<double, Size, Size>>(regions, C));
}

}  // namespace efree
