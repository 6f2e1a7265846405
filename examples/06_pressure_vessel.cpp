// SPDX-License-Identifier: GPL-3.0-or-later
/// A thick cylinder under internal pressure p (Lame 1852), of which half of a meridian section is meshed:
///
///   div sigma = 0,   sigma = C : eps,   eps_tt = u_r / r
///
///     z |     ______   top:    u_z = 0
///       |  p>|      |
///     axis p>|      |  outer:  sigma n = 0
///       |  p>|______|  bottom: u_z = 0
///       |    1      2  r
///
/// Prints the errors with 4 to 16 nodes through the wall, and the hoop stress at the inner wall, where it is largest.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

constexpr double E = 1.0, nu = 0.3, p = 1.0, a = 1.0, b = 2.0;
constexpr double A = p * a * a / (b * b - a * a), B = A * b * b;  ///< stresses A - B / r^2 along r, A + B / r^2 around

static double error(int through) {
  const double H = (b - a) / (through - 1);
  const auto displacement = [](const Vec<2>& x) {
    return Vec<2>((1 + nu) / E * ((1 - 2 * nu) * A * x[0] + B / x[0]), 0.0);
  };
  const auto stress = [](const Vec<2>& x) {
    return Voigt<2>(A - B / (x[0] * x[0]), 2 * nu * A, A + B / (x[0] * x[0]), 0.0);
  };
  const PlanarDomain section{.boundary = {{"bottom", {{a, 0}, {b, 0}}},
                                          {"outer", {{b, 0}, {b, 0.5}}},
                                          {"top", {{b, 0.5}, {a, 0.5}}},
                                          {"inner", {{a, 0.5}, {a, 0}}}}};
  const FineMesh<2> mesh = triangulate(section, {.size = H / 4});
  const Result<2> wall =
      analyse(mesh, {.common = {.model = {.material = LinearElastic(E, nu), .plane = Plane::axisymmetric},
                                .approximation = {.spacing = H}},
                     .supports = {symmetry_plane<2>("bottom"), symmetry_plane<2>("top")},
                     .loads = {.tractions = {pressure<2>("inner", [](const Vec<2>&) { return p; })}},
                     .exact = {displacement, stress},
                     .probes = {{"inner wall", {a, 0.25}}}});
  const double hoop = wall.probes[0].second.stress[2];
  std::printf(
      "%2d nodes through the wall: errors in displacement %.2e, in energy %.2e (estimated: %.2e), "
      "hoop stress %.4f (%+.2f %%)\n",
      through, *wall.errors->l2_displacement, *wall.errors->energy_norm, wall.estimates->total(), hoop,
      100.0 * (hoop / (A + B) - 1.0));
  return std::max({*wall.errors->l2_displacement, *wall.errors->energy_norm, std::abs(hoop / (A + B) - 1.0)});
}

int main() {
  const double coarse = error(4), middle = error(8), fine = error(16);
  return fine < middle && middle < coarse && fine < 0.001 ? 0 : 1;
}
