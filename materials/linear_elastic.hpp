// SPDX-License-Identifier: GPL-3.0-or-later
/// Isotropic linear elasticity.
#pragma once

#include "efree/core/types.hpp"

namespace efree {

/// What a mesh in the plane stands for.
enum class Plane {
  stress,        ///< a thin plate, per unit thickness
  strain,        ///< a slice of a body that cannot stretch along z, per unit thickness
  axisymmetric,  ///< half of a meridian section, x the radius and y the axis: the body of revolution
};

struct LinearElastic {
  double E = 0.0;   ///< Young's modulus [stress], positive
  double nu = 0.0;  ///< Poisson's ratio, in (-1, 0.5)
};

/// sigma = lambda tr(eps) I + 2 mu eps, in the Dim dimensions of the analysis.
struct Lame {
  double lambda = 0.0;  ///< [stress]
  double mu = 0.0;      ///< [stress]
};

/// In-plane Lame constants: 3D ones for plane strain and axisymmetry, lambda' = 2 lambda mu / (lambda + 2 mu) for plane
/// stress. Throws InputError for E <= 0 or nu outside (-1, 0.5).
Lame plane_lame(const LinearElastic& material, Plane plane);

/// Lame constants in space. Throws like plane_lame.
Lame solid_lame(const LinearElastic& material);
/// Those of an analysis in Dim dimensions: plane_lame in 2D; in 3D solid_lame, and `plane` means nothing.
template <int Dim> Lame lame_constants(const LinearElastic& material, Plane plane) {
  if constexpr (Dim == 2)
    return plane_lame(material, plane);
  else
    return solid_lame(material);
}

/// Part of the stiffness that sees volume changes: kappa = lambda + 2 mu / Normals, no shear.
template <int Normals> Lame volumetric(const Lame& lame) {
  return {lame.lambda + 2.0 * lame.mu / Normals, 0.0};
}
/// What remains: 2 mu times the deviator in as many dimensions as there are normal strains.
template <int Normals> Lame deviatoric(const Lame& lame) {
  return {-2.0 * lame.mu / Normals, lame.mu};
}

/// Stiffness in Voigt notation; strains carry engineering shear (gamma = 2 eps).
template <int Dim, int Normals = Dim> VoigtMatrix<Dim, Normals> stiffness(const Lame& lame);

/// von Mises stress from (xx, yy, xy), to which plane strain adds sigma_zz = nu (sigma_xx + sigma_yy), or axisymmetric
/// from (rr, zz, tt, rz).
double von_mises(const VoigtValue<2>& stress, Plane plane, double nu);
/// The same from all six components.
double von_mises(const Voigt<3>& stress);

}  // namespace efree
