// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/materials/linear_elastic.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree {

Lame solid_lame(const LinearElastic& material) {
  if (!(material.E > 0.0) || !std::isfinite(material.E))
    throw InputError(fmt::format("Young's modulus E = {}, expected a positive number", material.E));
  if (!(material.nu > -1.0 && material.nu < 0.5))
    throw InputError(fmt::format("Poisson's ratio nu = {}, expected a number in (-1, 0.5)", material.nu));
  const double mu = material.E / (2.0 * (1.0 + material.nu));
  const double lambda = material.E * material.nu / ((1.0 + material.nu) * (1.0 - 2.0 * material.nu));
  return {lambda, mu};
}

Lame plane_lame(const LinearElastic& material, Plane plane) {
  const auto [lambda, mu] = solid_lame(material);
  return {plane == Plane::stress ? 2.0 * lambda * mu / (lambda + 2.0 * mu) : lambda, mu};
}

template <int Dim, int Normals> VoigtMatrix<Dim, Normals> stiffness(const Lame& lame) {
  VoigtMatrix<Dim, Normals> C = VoigtMatrix<Dim, Normals>::Zero();
  C.template topLeftCorner<Normals, Normals>().setConstant(lame.lambda);
  C.diagonal().template head<Normals>().array() += 2.0 * lame.mu;
  C.diagonal().template tail<voigt_size<Dim, Normals> - Normals>().setConstant(lame.mu);
  return C;
}

namespace {

double von_mises(double xx, double yy, double zz, double shear_squared) {
  return std::sqrt(0.5 * ((xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx)) + 3.0 * shear_squared);
}

}  // namespace

double von_mises(const VoigtValue<2>& stress, Plane plane, double nu) {
  const double xx = stress[0], yy = stress[1];
  if (plane == Plane::axisymmetric) return von_mises(xx, yy, stress[2], stress[3] * stress[3]);
  return von_mises(xx, yy, plane == Plane::strain ? nu * (xx + yy) : 0.0, stress[2] * stress[2]);
}

double von_mises(const Voigt<3>& stress) {
  return von_mises(stress[0], stress[1], stress[2], stress.tail<3>().squaredNorm());
}

template VoigtMatrix<2> stiffness<2, 2>(const Lame&);
template VoigtMatrix<2, 3> stiffness<2, 3>(const Lame&);
template VoigtMatrix<3> stiffness<3, 3>(const Lame&);

}  // namespace efree
