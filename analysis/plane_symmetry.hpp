// SPDX-License-Identifier: GPL-3.0-or-later
/// Elastic tensors in the plane: engineering constants, axes, symmetry.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <string>

namespace efree {

/// Stiffness or compliance in the plane by xx, yy, xy with doubled shear strains.
using PlaneElasticTensor = Mat<3>;

/// Frobenius norm of C_ijkl in the plane: that of the matrix in Kelvin's notation.
double plane_norm_of(const PlaneElasticTensor& stiffness);
/// The stiffness in axes turned by an angle [radians], counterclockwise.
PlaneElasticTensor in_axes(const PlaneElasticTensor& stiffness, double angle);
/// Likewise the compliance.
PlaneElasticTensor compliance_in_axes(const PlaneElasticTensor& compliance, double angle);

/// From the compliance, as if the axes were those of orthotropy. In plane strain these are the constants of a body that
/// is kept from moving across: of one isotropic material E / (1 - nu^2) and nu / (1 - nu).
struct PlaneEngineeringConstants {
  Vec<2> E;   ///< Young's moduli along x, y [stress]
  double G;   ///< shear modulus xy [stress]
  double nu;  ///< nu_xy: contraction along y under stress along x
};
PlaneEngineeringConstants plane_engineering_constants(const PlaneElasticTensor& compliance);
/// 1 / (n n : S : n n) for a unit vector n [stress].
double plane_youngs_modulus(const PlaneElasticTensor& compliance, const Vec<2>& n);

enum class PlaneSymmetryClass { isotropic, square, orthotropic, none };
/// "isotropic", "square", "orthotropic", "lower than orthotropic".
std::string text_of(PlaneSymmetryClass symmetry);

/// Symmetry of a stiffness in the plane, from the parts of it that turn two and four times as fast as the axes
/// (Verchery 1979; Vannucci 2018), and what the projection on each class leaves, relative to the norm.
struct PlaneSymmetry {
  double angle;  ///< of the first axis of orthotropy from x, in (-45, 45] degrees [radians]; 0 if x does about as well
  PlaneElasticTensor there;           ///< the stiffness in these axes
  std::array<double, 3> distances{};  ///< from isotropic, square, orthotropic tensors
  double kappa, mu;  ///< of the isotropic projection [stress]; kappa: mean stress over the change of area
};
/// Throws InputError for a tensor without norm.
PlaneSymmetry plane_symmetry_of(const PlaneElasticTensor& stiffness);
/// The highest class that a tensor is no further away from than this.
PlaneSymmetryClass nearest_class(const PlaneSymmetry& symmetry, double tolerance);

}  // namespace efree
