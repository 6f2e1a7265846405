// SPDX-License-Identifier: GPL-3.0-or-later
/// Quarter of an infinite plate with a hole of radius 1 in unit tension along x (Kirsch 1898), plane stress, E = 1,
/// nu = 0.3, on [0, 4]^2: symmetry on the sides x = 0 and y = 0, exact tractions on the two others.
#pragma once

#include "efree/tests/bodies.hpp"

namespace efree::testing::kirsch {

constexpr double E = 1.0, nu = 0.3;

inline Voigt<2> stress(const Vec<2>& x) {
  const double t = std::atan2(x.y(), x.x()), q = 1.0 / x.squaredNorm();
  const double c2 = std::cos(2 * t), c4 = std::cos(4 * t), s2 = std::sin(2 * t), s4 = std::sin(4 * t);
  return {1.0 - q * (1.5 * c2 + c4) + 1.5 * q * q * c4, -q * (0.5 * c2 - c4) - 1.5 * q * q * c4, 0.0,
          -q * (0.5 * s2 + s4) + 1.5 * q * q * s4};
}

inline Vec<2> displacement(const Vec<2>& x) {
  const double r = x.norm(), t = std::atan2(x.y(), x.x()), k = (3.0 - nu) / (1.0 + nu), r3 = r * r * r;
  return (1.0 + nu) / (4.0 * E) *
         Vec<2>(r * (k + 1.0) * std::cos(t) + 2.0 / r * ((1.0 + k) * std::cos(t) + std::cos(3 * t)) -
                    2.0 / r3 * std::cos(3 * t),
                r * (k - 3.0) * std::sin(t) + 2.0 / r * ((1.0 - k) * std::sin(t) + std::sin(3 * t)) -
                    2.0 / r3 * std::sin(3 * t));
}

struct Result {
  double nodes, l2, energy, recovered;
};

inline FineMesh<2> mesh(double size) {
  return triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, size), {.size = size});
}

inline Result solve(const FineMesh<2>& fine, const ApproximationOptions& options) {
  const auto approximation = approximate(fine, options);
  const ElasticModel model{.material = LinearElastic(E, nu), .plane = Plane::stress};
  const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
  const auto pulled = [](const Vec<2>& x, const Vec<2>& n) { return traction<2>(stress(x), n); };
  const auto solution =
      ElasticSolver<2>(approximation, model, {{"left", {zero, nullptr}, {}}, {"bottom", {nullptr, zero}, {}}})
          .solve({{{"right", pulled}, {"top", pulled}}, {}});
  const auto errors = errors_against<2>(approximation, recover_fields(approximation, solution),
                                        materials_of(model, fine), {displacement, stress});
  return {static_cast<double>(approximation.nodes.cols()), *errors.l2_displacement, *errors.energy_norm,
          *errors.energy_norm_recovered};
}

/// Median of every number over clouds with three seeds.
inline Result median(const FineMesh<2>& fine, ApproximationOptions options) {
  std::array<Result, 3> runs;
  for (int s = 0; s < 3; ++s) {
    options.seed = static_cast<std::uint64_t>(s + 1);
    runs[s] = solve(fine, options);
  }
  const auto middle = [&](double Result::*field) {
    return std::max(std::min(runs[0].*field, runs[1].*field),
                    std::min(std::max(runs[0].*field, runs[1].*field), runs[2].*field));
  };
  return {middle(&Result::nodes), middle(&Result::l2), middle(&Result::energy), middle(&Result::recovered)};
}

}  // namespace efree::testing::kirsch
