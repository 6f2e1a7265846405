// SPDX-License-Identifier: GPL-3.0-or-later
/// Deformation gradients as finite-strain materials need them, and products of tensors as 9 x 9 matrices.
#pragma once

#include "efree/materials/material.hpp"

namespace efree::internal {

inline const Mat<3> identity = Mat<3>::Identity();

/// det(I + H) - 1, accurate for small H.
double growth(const Mat<3>& H);

/// Where a point is for a message: "at (x, y, z)".
std::string place(const Vec<3>& X);

struct FiniteDeformation {
  /// Of a point. Throws NumericalError, with the place, unless det F is positive and finite.
  FiniteDeformation(const Deformation& given, Index p);

  Mat<3> F, H;    ///< H = F - I
  double growth;  ///< J - 1
  double J, log_J;
  Mat<3> F_invT() const;  ///< F^-T
  /// (F^T F - 1) / 2.
  Mat<3> green() const { return 0.5 * (H + H.transpose() + H.transpose() * H); }
};

/// (i + 3 J, k + 3 L): A(i, k) B(J, L): the derivative of A dF B^T.
MaterialResponse::Tangent paired(const Mat<3>& A, const Mat<3>& B);
/// (i + 3 J, k + 3 L): A(i, L) B(k, J): the derivative of A dF^T B.
MaterialResponse::Tangent crossed(const Mat<3>& A, const Mat<3>& B);

/// U(J) = kappa / 4 (J^2 - 1 - 2 ln J) (Simo & Taylor 1982): grows without bounds towards J = 0 and J = infinity.
struct Volumetric {
  Volumetric(double kappa, const FiniteDeformation& of)
      : energy(0.25 * kappa * (of.growth * (2.0 + of.growth) - 2.0 * of.log_J)),
        stress(0.5 * kappa * of.growth * (2.0 + of.growth)),
        slope(kappa * of.J * of.J) {}
  double energy;
  double stress;  ///< J U'(J), a Kirchhoff pressure, positive in tension
  double slope;   ///< of it by ln J
};

}  // namespace efree::internal
