// SPDX-License-Identifier: GPL-3.0-or-later
/// The spherical cavity that studies and tests share: one eighth of a cube with the exact tractions of the infinite
/// body on its outer sides (Goodier 1933).
#pragma once

#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <cmath>

namespace efree::bench {

/// Infinite body with a spherical cavity of radius 1 under unit tension along z, E = 1, nu in ten thousandths.
template <int TenThousandths> struct CavityIn {
  static constexpr double half_width = 2.0;  ///< of the eighth that is analysed
  static constexpr IsotropicModuli material{1.0, TenThousandths / 1e4};

  /// u = f(r, c) n + g(r, c) e + the uniform field, with n = x / r, e the axis of tension, c = n . e.
  static Vec<3> displacement(const Vec<3>& x) {
    const Terms t(x);
    return t.f * t.n + t.g * Vec<3>::UnitZ() + Vec<3>(-material.nu, -material.nu, 1.0).cwiseProduct(x) / material.E;
  }
  static Voigt<3> stress(const Vec<3>& x) {
    const Terms t(x);
    const Vec<3> e = Vec<3>::UnitZ(), dc = (e - t.c * t.n) / t.r;
    Mat<3> H = t.n * (t.f_r * t.n + t.f_c * dc).transpose() + t.f / t.r * (Mat<3>::Identity() - t.n * t.n.transpose()) +
               e * (t.g_r * t.n + t.g_c * dc).transpose();
    H.diagonal() += Vec<3>(-material.nu, -material.nu, 1.0) / material.E;
    Voigt<3> strain;
    strain << H(0, 0), H(1, 1), H(2, 2), H(1, 2) + H(2, 1), H(0, 2) + H(2, 0), H(0, 1) + H(1, 0);
    static const Materials<3> materials({LinearElastic(material)}, Plane::strain);
    return materials.stiffness(0, x).C * strain;
  }
  static Vec<3> traction(const Vec<3>& x, const Vec<3>& n) { return efree::traction<3>(stress(x), n); }

  static FineMesh<3> mesh(double size) { return FineMesh<3>(solids::spherical_cavity(1.0, half_width, size)); }
  /// The sides on which displacements are prescribed.
  static std::vector<std::string> held() { return {"left", "front", "bottom"}; }

  static ElasticSolver<3> solver(const Approximation<3>& approximation, Essential essential,
                                 const Monitor& monitor = {}) {
    return ElasticSolver<3>(approximation, {.material = LinearElastic(material), .essential = essential},
                            {symmetry_plane<3>("left"), symmetry_plane<3>("front"), symmetry_plane<3>("bottom")},
                            monitor);
  }
  static Loads<3> loads() {
    return {.tractions = {{"right", traction}, {"back", traction}, {"top", traction}}, .body_force = {}};
  }
  static Errors errors(const Approximation<3>& approximation, const Solution<3>& solution) {
    return errors_against<3>(approximation, recover_fields(approximation, solution),
                             Materials<3>({LinearElastic(material)}, Plane::strain), {displacement, stress});
  }

 private:
  struct Terms {
    Vec<3> n;
    double r, c, f, g, f_r, f_c, g_r, g_c;

    explicit Terms(const Vec<3>& x) : n(x.normalized()), r(x.norm()), c(n.z()) {
      constexpr double nu = material.nu, G = material.E / (2.0 * (1.0 + nu)),
                       share = 1.0 / (8.0 * G * (7.0 - 5.0 * nu));
      constexpr double A = -(13.0 - 10.0 * nu) * share, B = share, C = 5.0 * (1.0 - 2.0 * nu) * share;
      constexpr double k = (5.0 - 4.0 * nu) / (1.0 - 2.0 * nu);
      const double q = 1.0 / (r * r), q2 = q * q;
      // u_r = P + Q cos 2 theta, u_theta = -K sin 2 theta
      const double P = -A * q - 3.0 * B * q2, Q = k * C * q - 9.0 * B * q2, K = 2.0 * C * q + 6.0 * B * q2;
      const double P_r = (2.0 * A * q + 12.0 * B * q2) / r, Q_r = (-2.0 * k * C * q + 36.0 * B * q2) / r,
                   K_r = (-4.0 * C * q - 24.0 * B * q2) / r;
      f = P + Q * (2.0 * c * c - 1.0) - 2.0 * K * c * c;
      g = 2.0 * K * c;
      f_r = P_r + Q_r * (2.0 * c * c - 1.0) - 2.0 * K_r * c * c;
      f_c = 4.0 * c * (Q - K);
      g_r = 2.0 * K_r * c;
      g_c = 2.0 * K;
    }
  };
};
using Cavity = CavityIn<3000>;

}  // namespace efree::bench
