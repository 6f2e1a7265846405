// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/plane_symmetry.hpp"

#include "efree/core/error.hpp"

#include <cmath>
#include <complex>
#include <numbers>

namespace efree {
namespace {

/// Strains in axes turned by an angle, from those in x and y.
Mat<3> strains_in_axes(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  Mat<3> turn;
  turn << c * c, s * s, c * s, s * s, c * c, -c * s, -2.0 * c * s, 2.0 * c * s, c * c - s * s;
  return turn;
}

/// The parts of a stiffness by how they turn.
struct PolarParts {
  double mu, kappa;                ///< do not
  std::complex<double> four, two;  ///< by four and two times the angle: R0 exp(4 i Phi0), R1 exp(2 i Phi1)

  explicit PolarParts(const PlaneElasticTensor& C)
      : mu((C(0, 0) - 2.0 * C(0, 1) + 4.0 * C(2, 2) + C(1, 1)) / 8.0),
        kappa((C(0, 0) + 2.0 * C(0, 1) + C(1, 1)) / 4.0),
        four((C(0, 0) - 2.0 * C(0, 1) - 4.0 * C(2, 2) + C(1, 1)) / 8.0, (C(0, 2) - C(1, 2)) / 2.0),
        two((C(0, 0) - C(1, 1)) / 8.0, (C(0, 2) + C(1, 2)) / 4.0) {}
  /// Distance from orthotropy in axes turned by an angle: the norm of C_16 and C_26 there.
  double from_orthotropy(double angle) const {
    const double at_four = (four * std::polar(1.0, -4.0 * angle)).imag(),
                 at_two = (two * std::polar(1.0, -2.0 * angle)).imag();
    return std::sqrt(8.0 * at_four * at_four + 32.0 * at_two * at_two);
  }
};

/// The angle in (-45, 45] degrees at which a function with a period of 90 is least.
template <class F> double least_angle(const F& f) {
  constexpr int samples = 180;
  constexpr double quarter = 0.25 * std::numbers::pi, step = 2.0 * quarter / samples;
  double best = 0.0;
  for (int i = 1; i <= samples; ++i)
    if (const double angle = -quarter + i * step; f(angle) < f(best)) best = angle;
  for (double width = step; width > 1e-12; width *= 0.5)
    for (const double angle : {best - width, best + width})
      if (f(angle) < f(best)) best = angle;
  return best > quarter ? best - 2.0 * quarter : best <= -quarter ? best + 2.0 * quarter : best;
}

}  // namespace

double plane_norm_of(const PlaneElasticTensor& stiffness) {
  PlaneElasticTensor kelvin = stiffness;
  kelvin.row(2) *= std::sqrt(2.0);
  kelvin.col(2) *= std::sqrt(2.0);
  return kelvin.norm();
}
PlaneElasticTensor in_axes(const PlaneElasticTensor& stiffness, double angle) {
  const Mat<3> back = strains_in_axes(-angle);
  return back.transpose() * stiffness * back;
}
PlaneElasticTensor compliance_in_axes(const PlaneElasticTensor& compliance, double angle) {
  const Mat<3> turn = strains_in_axes(angle);
  return turn * compliance * turn.transpose();
}

PlaneEngineeringConstants plane_engineering_constants(const PlaneElasticTensor& compliance) {
  return {.E = compliance.diagonal().head<2>().cwiseInverse(),
          .G = 1.0 / compliance(2, 2),
          .nu = -compliance(1, 0) / compliance(0, 0)};
}
double plane_youngs_modulus(const PlaneElasticTensor& compliance, const Vec<2>& n) {
  const Vec<3> stress(n[0] * n[0], n[1] * n[1], n[0] * n[1]);
  return 1.0 / stress.dot(compliance * stress);
}

std::string text_of(PlaneSymmetryClass symmetry) {
  switch (symmetry) {
    case PlaneSymmetryClass::isotropic:
      return "isotropic";
    case PlaneSymmetryClass::square:
      return "square";
    case PlaneSymmetryClass::orthotropic:
      return "orthotropic";
    case PlaneSymmetryClass::none:
      break;
  }
  return "lower than orthotropic";
}

PlaneSymmetry plane_symmetry_of(const PlaneElasticTensor& stiffness) {
  const double norm = plane_norm_of(stiffness);
  if (!(norm > 0.0)) throw InputError("a tensor without norm has no symmetry");
  constexpr double as_well = 1e-3;  // of the norm: what other axes have to be better by
  const PolarParts parts(stiffness);
  const auto distance = [&](double angle) { return parts.from_orthotropy(angle); };
  double angle = least_angle(distance);
  if (distance(0.0) <= distance(angle) + as_well * norm) angle = 0.0;
  const double four = 8.0 * std::norm(parts.four), two = 32.0 * std::norm(parts.two);
  return {.angle = angle,
          .there = in_axes(stiffness, angle),
          .distances = {std::sqrt(four + two) / norm, std::sqrt(two) / norm, distance(angle) / norm},
          .kappa = parts.kappa,
          .mu = parts.mu};
}

PlaneSymmetryClass nearest_class(const PlaneSymmetry& symmetry, double tolerance) {
  for (const PlaneSymmetryClass one :
       {PlaneSymmetryClass::isotropic, PlaneSymmetryClass::square, PlaneSymmetryClass::orthotropic})
    if (symmetry.distances[static_cast<std::size_t>(one)] <= tolerance) return one;
  return PlaneSymmetryClass::none;
}

}  // namespace efree
