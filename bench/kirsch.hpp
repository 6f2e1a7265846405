// SPDX-License-Identifier: GPL-3.0-or-later
/// The plate with a hole that the studies of bench/ share: a quarter of a square plate with the exact tractions of the
/// infinite one on its outer sides (Kirsch 1898; Timoshenko & Goodier, Theory of Elasticity, section 35).
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

#include <cmath>

namespace efree::bench {

/// Infinite plate in plane stress with a circular hole of radius 1 under unit tension along x, E = 1, nu = 0.3.
struct Kirsch {
  static constexpr double half_width = 4.0;  ///< of the quarter that is analysed
  static constexpr IsotropicModuli material{1.0, 0.3};

  static Voigt<2> stress(const Vec<2>& x) {
    const double t = std::atan2(x.y(), x.x()), q = 1.0 / x.squaredNorm();
    const double c2 = std::cos(2 * t), s2 = std::sin(2 * t), c4 = std::cos(4 * t), s4 = std::sin(4 * t);
    return {1.0 - q * (1.5 * c2 + c4) + 1.5 * q * q * c4, -q * (0.5 * c2 - c4) - 1.5 * q * q * c4, 0.0,
            -q * (0.5 * s2 + s4) + 1.5 * q * q * s4};
  }
  static Vec<2> displacement(const Vec<2>& x) {
    const double kappa = (3.0 - material.nu) / (1.0 + material.nu), r = x.norm(), t = std::atan2(x.y(), x.x());
    const double scale = 0.25 * (1.0 + material.nu) / material.E, cubed = 2.0 / (r * r * r);
    return scale * Vec<2>(r * (kappa + 1) * std::cos(t) + 2 / r * ((1 + kappa) * std::cos(t) + std::cos(3 * t)) -
                              cubed * std::cos(3 * t),
                          r * (kappa - 3) * std::sin(t) + 2 / r * ((1 - kappa) * std::sin(t) + std::sin(3 * t)) -
                              cubed * std::sin(3 * t));
  }
  static Vec<2> traction(const Vec<2>& x, const Vec<2>& n) { return efree::traction<2>(stress(x), n); }

  static FineMesh<2> mesh(double size) {
    return triangulate(shapes::quarter_plate_with_hole(1.0, half_width, size), {.size = size});
  }
  /// The sides on which displacements are prescribed.
  static std::vector<std::string> held() { return {"left", "bottom"}; }

  static ElasticSolver<2> solver(const Approximation<2>& approximation, Essential essential) {
    return ElasticSolver<2>(approximation,
                            {.material = LinearElastic(material), .plane = Plane::stress, .essential = essential},
                            {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")});
  }
  static Loads<2> loads() { return {.tractions = {{"right", traction}, {"top", traction}}, .body_force = {}}; }
  static Errors errors(const Approximation<2>& approximation, const Solution<2>& solution) {
    return errors_against<2>(approximation, recover_fields(approximation, solution),
                             Materials<2>({LinearElastic(material)}, Plane::stress), {displacement, stress});
  }
};

}  // namespace efree::bench
