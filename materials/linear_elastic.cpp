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
  return {plane == Plane::strain ? lambda : 2.0 * lambda * mu / (lambda + 2.0 * mu), mu};
}

template <int Dim> VoigtMatrix<Dim> stiffness(const Lame& lame) {
  VoigtMatrix<Dim> C = VoigtMatrix<Dim>::Zero();
  C.template topLeftCorner<Dim, Dim>().setConstant(lame.lambda);
  C.diagonal().template head<Dim>().array() += 2.0 * lame.mu;
  C.diagonal().template tail<voigt_size<Dim> - Dim>().setConstant(lame.mu);
  return C;
}

double von_mises(const Voigt<2>& stress, Plane plane, double nu) {
  const double xx = stress[0], yy = stress[1], xy = stress[2];
  const double zz = plane == Plane::strain ? nu * (xx + yy) : 0.0;
  return std::sqrt(0.5 * ((xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx)) + 3.0 * xy * xy);
}

double von_mises(const Voigt<3>& stress) {
  const double xx = stress[0], yy = stress[1], zz = stress[2];
  return std::sqrt(0.5 * ((xx - yy) * (xx - yy) + (yy - zz) * (yy - zz) + (zz - xx) * (zz - xx)) +
                   3.0 * stress.tail<3>().squaredNorm());
}

template VoigtMatrix<2> stiffness<2>(const Lame&);
template VoigtMatrix<3> stiffness<3>(const Lame&);

}  // namespace efree
