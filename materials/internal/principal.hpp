// SPDX-License-Identifier: GPL-3.0-or-later
/// Isotropic laws along principal axes: whoever writes one writes three stresses as functions of three strains.
#pragma once

#include "efree/materials/material.hpp"

namespace efree::internal {

/// What an isotropic law says of principal strains: at finite strains Kirchhoff stress by logarithmic strain.
struct PrincipalStress {
  Vec<3> stress;
  Mat<3> slope;   ///< of stress i by strain j
  Mat<3> secant;  ///< (stress i - stress j) / (strain i - strain j) for i != j; of equal strains slope ii - slope ij

  /// kappa tr(strain) 1 + 2 mu dev(strain).
  static PrincipalStress linear(const Vec<3>& strain, double kappa, double mu);
};

/// A deformation along its principal axes, strains ascending. First Piola-Kirchhoff stress and tangent are those of
/// the isotropic law, to rounding also where strains are equal or nearly so: differences over differences are the
/// law's secants and log1p(x) / x, and nothing is perturbed (Ogden 1997; Miehe 1998).
class PrincipalFrame {
 public:
  /// Of a small strain: sigma = sum of stress n n^T.
  explicit PrincipalFrame(const Mat<3>& small_strain);
  /// Of the elastic deformation F G, G what undoes a plastic one: P = tau F^-T. Strains are logarithmic.
  PrincipalFrame(const Mat<3>& F, const Mat<3>& G);

  const Vec<3>& strain() const { return strain_; }
  /// P.
  Mat<3> stress(const Vec<3>& principal) const;
  /// dP / dF.
  MaterialResponse::Tangent tangent(const PrincipalStress& law) const;
  /// The sum of value n n^T over the axes; at finite strains n = G times the unit axes of the reference.
  Mat<3> tensor(const Vec<3>& values) const;

 private:
  Mat<3> current_, reference_;  // columns: axes
  Vec<3> strain_, stretch_;
  bool finite_;
};

/// Symmetric tensors by xx, yy, zz, yz, xz, xy.
Mat<3> symmetric(const Eigen::Ref<const Vec<6>>& components);
Vec<6> components(const Mat<3>& symmetric);

}  // namespace efree::internal
