// SPDX-License-Identifier: GPL-3.0-or-later
/// What an elastic tensor says: engineering constants, axes, symmetry, anisotropy.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <string>

namespace efree {

/// Stiffness or compliance by xx, yy, zz, yz, xz, xy with doubled shear strains.
using ElasticTensor = VoigtMatrix<3>;

/// Frobenius norm of C_ijkl: that of the matrix in Kelvin's notation (Mehrabadi & Cowin 1990).
double norm_of(const ElasticTensor& stiffness);
/// The tensor in axes that are the columns of a rotation.
ElasticTensor in_axes(const ElasticTensor& stiffness, const Mat<3>& axes);

/// From the compliance, as if the axes were those of orthotropy.
struct EngineeringConstants {
  Vec<3> E;   ///< Young's moduli along x, y, z [stress]
  Vec<3> G;   ///< shear moduli yz, xz, xy [stress]
  Vec<3> nu;  ///< nu_yz, nu_xz, nu_xy: contraction along the second axis under stress along the first
};
EngineeringConstants engineering_constants(const ElasticTensor& compliance);
/// 1 / (n n : S : n n) for a unit vector n [stress].
double youngs_modulus(const ElasticTensor& compliance, const Vec<3>& n);

enum class SymmetryClass { isotropic, cubic, transversely_isotropic, orthotropic, none };
/// "isotropic", "cubic", "transversely isotropic", "orthotropic", "lower than orthotropic".
std::string text_of(SymmetryClass symmetry);

/// Symmetry of a stiffness: its orthogonal projections on tensors of each class (Moakher & Norris 2006) and what they
/// leave, relative to its norm.
struct ElasticSymmetry {
  Mat<3> axes;          ///< columns: those in which it is next to orthotropic; the image's if these do about as well
  ElasticTensor there;  ///< the stiffness in these axes
  std::array<double, 4> distances{};  ///< from isotropic, cubic, transversely isotropic, orthotropic tensors
  int special_axis = 2;               ///< of these axes: that of transverse isotropy
  double kappa, mu;                   ///< of the isotropic projection [stress]
  double zener;                       ///< 2 C44 / (C11 - C12) of the cubic projection
};
/// Throws InputError for a tensor without norm.
ElasticSymmetry symmetry_of(const ElasticTensor& stiffness);
/// The highest class that a tensor is no further away from than this.
SymmetryClass nearest_class(const ElasticSymmetry& symmetry, double tolerance);

/// 5 G_V / G_R + kappa_V / kappa_R - 6, zero for isotropic tensors (Ranganathan & Ostoja-Starzewski 2008).
double universal_anisotropy(const ElasticTensor& stiffness, const ElasticTensor& compliance);

}  // namespace efree
