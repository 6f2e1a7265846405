// SPDX-License-Identifier: GPL-3.0-or-later
/// A large plate with a circular hole under tension S along x (Kirsch 1898), a quarter of it:
///
///   div sigma = 0,   sigma = C : sym(grad u)
///
///      y |  top: sigma n exact            x = 0: u_x = 0      (symmetry)
///        |--------------|                 y = 0: u_y = 0      (symmetry)
///        |              |  right:         hole:  sigma n = 0
///         \_            |  sigma n
///           |___________|_ x exact
///
/// Solved on finer and finer clouds and meshes. Prints the relative errors of the displacement and of the energy norm,
/// what was estimated of the latter, and the observed order.
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>

using namespace efree;

constexpr double a = 1.0, S = 1.0, E = 1.0, nu = 0.3;

/// Timoshenko & Goodier, Theory of Elasticity, section 35.
static Voigt<2> exact_stress(const Vec<2>& x) {
  const double t = std::atan2(x.y(), x.x()), q = a * a / x.squaredNorm(), c2 = std::cos(2 * t), c4 = std::cos(4 * t);
  return {S * (1 - q * (1.5 * c2 + c4) + 1.5 * q * q * c4), S * (-q * (0.5 * c2 - c4) - 1.5 * q * q * c4), 0.0,
          S * (-q * (0.5 * std::sin(2 * t) + std::sin(4 * t)) + 1.5 * q * q * std::sin(4 * t))};
}

static Vec<2> exact_displacement(const Vec<2>& x) {
  const double r = x.norm(), t = std::atan2(x.y(), x.x()), mu = E / (2 * (1 + nu)), kappa = (3 - nu) / (1 + nu);
  const double c = S * a / (8 * mu), s = r / a, c3 = std::cos(3 * t), s3 = std::sin(3 * t);
  return {c * (s * (kappa + 1) * std::cos(t) + 2 / s * ((1 + kappa) * std::cos(t) + c3) - 2 * c3 / (s * s * s)),
          c * (s * (kappa - 3) * std::sin(t) + 2 / s * ((1 - kappa) * std::sin(t) + s3) - 2 * s3 / (s * s * s))};
}

static double error(double H) {
  const auto exact_traction = [](const Vec<2>& x, const Vec<2>& n) { return traction<2>(exact_stress(x), n); };
  const FineMesh<2> mesh = triangulate(shapes::quarter_plate_with_hole(a, 4.0 * a, H / 4), {.size = H / 4});
  const Result<2> plate = analyse(mesh, {.common = {.model = {.material = LinearElastic(E, nu), .plane = Plane::stress},
                                                    .approximation = {.spacing = H}},
                                         .supports = {symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                                         .loads = {.tractions = {{"right", exact_traction}, {"top", exact_traction}}},
                                         .exact = {exact_displacement, exact_stress}});
  std::printf("H = %.2f: %5d nodes, error in displacement %.2e, in energy %.2e (estimated: %.2e)\n", H,
              plate.approximation.shape.num_nodes(), *plate.errors->l2_displacement, *plate.errors->energy_norm,
              plate.estimates->total());
  return *plate.errors->l2_displacement;
}

int main() {
  const double coarse = error(0.8), middle = error(0.4), fine = error(0.2);
  std::printf("observed orders in displacement: %.2f, %.2f\n", std::log2(coarse / middle), std::log2(middle / fine));
  return fine < coarse / 4 ? 0 : 1;
}
