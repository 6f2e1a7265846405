// SPDX-License-Identifier: GPL-3.0-or-later
/// From the gradients of a table to deformation gradients, and back: what the plane, the body of revolution and the
/// solid differ in.
#pragma once

#include "efree/basis/shape_table.hpp"
#include "efree/core/types.hpp"

#include <array>
#include <cmath>

namespace efree {

/// Components of a displacement's gradient H(i, J) = du_i / dX_J that are not zero for good. In 2D xx, yx, xy, yy and
/// zz: the hoop strain u_r / r of a body of revolution, and zero in the plane. In space all nine, by columns.
template <int Dim> inline constexpr int gradient_size = Dim == 2 ? 5 : 9;
/// These components.
template <int Dim> using Gradient = Vec<gradient_size<Dim>>;
/// A gradient, or what does work on one (first Piola-Kirchhoff stress), in every column = point.
template <int Dim> using Gradients = Points<gradient_size<Dim>>;
/// Derivative of stresses by gradients.
template <int Dim> using Tangent = Mat<gradient_size<Dim>>;
/// Gradient of a displacement by that of one node, and other things that have such columns.
template <int Dim> using GradientBlock = Eigen::Matrix<double, gradient_size<Dim>, Dim>;

/// Where these components are in a tensor flattened by columns.
template <int Dim> inline constexpr std::array<int, gradient_size<Dim>> tensor_places = {};
template <> inline constexpr std::array<int, 5> tensor_places<2>{0, 1, 3, 4, 8};
template <> inline constexpr std::array<int, 9> tensor_places<3>{0, 1, 2, 3, 4, 5, 6, 7, 8};

/// A function at a point, as gradients see it: its gradient and (axisymmetric) its value over the radius.
template <int Dim> struct NodalGradient {
  Vec<Dim> dN;
  double hoop = 0.0;

  /// The gradient that the displacement u of the node makes.
  Gradient<Dim> of(const Vec<Dim>& u) const {
    Gradient<Dim> H;
    for (int J = 0; J < Dim; ++J) H.template segment<Dim>(Dim * J) = dN[J] * u;
    if constexpr (Dim == 2) H[4] = hoop * u[0];
    return H;
  }
  /// The adjoint: the force f on the node with f . u = P : of(u). P n for a normal n in the place of dN.
  Vec<Dim> force(const Gradient<Dim>& P) const {
    Vec<Dim> f = dN[0] * P.template head<Dim>();
    for (int J = 1; J < Dim; ++J) f += dN[J] * P.template segment<Dim>(Dim * J);
    if (Dim == 2 && hoop != 0.0) f[0] += hoop * P[gradient_size<Dim> - 1];
    return f;
  }
  /// Stresses by the node's displacement: columns A of(e_k).
  GradientBlock<Dim> stress(const Tangent<Dim>& A) const {
    GradientBlock<Dim> columns = dN[0] * A.template leftCols<Dim>();
    for (int J = 1; J < Dim; ++J) columns += dN[J] * A.template middleCols<Dim>(Dim * J);
    if (Dim == 2 && hoop != 0.0) columns.col(0) += hoop * A.col(gradient_size<Dim> - 1);
    return columns;
  }
  /// Forces by the columns: force(column k) in column k.
  Mat<Dim> forces(const GradientBlock<Dim>& columns) const {
    Mat<Dim> f = dN[0] * columns.template topRows<Dim>();
    for (int J = 1; J < Dim; ++J) f += dN[J] * columns.template middleRows<Dim>(Dim * J);
    if (Dim == 2 && hoop != 0.0) f.row(0) += hoop * columns.row(gradient_size<Dim> - 1);
    return f;
  }
  /// What the dilatation is along: tr of(u) = dilatation() . u.
  Vec<Dim> dilatation() const {
    Vec<Dim> d = dN;
    d[0] += hoop;
    return d;
  }
};
/// Of the k-th node in a row of a table with gradients.
template <int Dim> NodalGradient<Dim> nodal_gradient(const ShapeRow<Dim>& row, std::size_t k) {
  return {row.dN[k], row.hoop.empty() ? 0.0 : row.hoop[k]};
}

/// The trace, as a gradient's component along this.
template <int Dim> Gradient<Dim> trace_direction() {
  Gradient<Dim> m = Gradient<Dim>::Zero();
  for (int i = 0; i < Dim; ++i) m[(Dim + 1) * i] = 1.0;
  if constexpr (Dim == 2) m[4] = 1.0;
  return m;
}

/// Symmetric part of a gradient in Voigt order, with engineering shear.
template <int Dim> Voigt<Dim> strain_of(const Gradient<Dim>& H) {
  if constexpr (Dim == 2)
    return {H[0], H[3], H[4], H[1] + H[2]};
  else
    return (Voigt<3>() << H[0], H[4], H[8], H[5] + H[7], H[2] + H[6], H[1] + H[3]).finished();
}
/// The symmetric gradient with that strain.
template <int Dim> Gradient<Dim> gradient_of(const Voigt<Dim>& strain) {
  Gradient<Dim> H;
  if constexpr (Dim == 2)
    H << strain[0], 0.5 * strain[3], 0.5 * strain[3], strain[1], strain[2];
  else
    H << strain[0], 0.5 * strain[5], 0.5 * strain[4], 0.5 * strain[5], strain[1], 0.5 * strain[3], 0.5 * strain[4],
        0.5 * strain[3], strain[2];
  return H;
}
/// A symmetric stress in Voigt order.
template <int Dim> Voigt<Dim> stress_of(const Gradient<Dim>& P) {
  if constexpr (Dim == 2)
    return {P[0], P[3], P[4], P[2]};
  else
    return (Voigt<3>() << P[0], P[4], P[8], P[7], P[6], P[3]).finished();
}
/// The tangent of a material at small strains in Voigt order.
template <int Dim> VoigtMatrix<Dim> voigt_of(const Tangent<Dim>& A) {
  VoigtMatrix<Dim> C;
  constexpr auto at = [] {  // one of the components that stand for each of Voigt's
    if constexpr (Dim == 2)
      return std::array{0, 3, 4, 2};
    else
      return std::array{0, 4, 8, 7, 6, 3};
  }();
  for (int i = 0; i < voigt_size<Dim>; ++i)
    for (int j = 0; j < voigt_size<Dim>; ++j) C(i, j) = A(at[i], at[j]);
  return C;
}

/// von Mises stress, of any finite numbers.
template <int Dim> double von_mises(const Voigt<Dim>& stress) {
  const auto of = [](const Voigt<Dim>& s) {
    const double xx = s[0], yy = s[1], zz = s[2];
    return std::sqrt(0.5 * ((xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx)) +
                     3.0 * s.template tail<voigt_size<Dim> - 3>().squaredNorm());
  };
  const double largest = stress.cwiseAbs().maxCoeff();
  if (largest > 1e-140 && largest < 1e140) return of(stress);  // its squares are in range
  return largest > 0.0 ? largest * of(stress / largest) : largest;
}

/// Traction of a symmetric stress in Voigt order on a facet with normal n.
template <int Dim> Vec<Dim> traction(const Voigt<Dim>& stress, const Vec<Dim>& n) {
  if constexpr (Dim == 2)
    return {stress[0] * n[0] + stress[3] * n[1], stress[3] * n[0] + stress[1] * n[1]};
  else
    return {stress[0] * n[0] + stress[5] * n[1] + stress[4] * n[2],
            stress[5] * n[0] + stress[1] * n[1] + stress[3] * n[2],
            stress[4] * n[0] + stress[3] * n[1] + stress[2] * n[2]};
}

}  // namespace efree
