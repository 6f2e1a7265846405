// SPDX-License-Identifier: GPL-3.0-or-later
/// The built-in baselines on a smooth manufactured solution: body force and all displacements from
/// u = (sin(pi x) cos(pi y), x^2 y / 2 + cos(pi x) sin(pi y)) on an L.
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

using std::numbers::pi;

struct Manufactured {
  Lame lame;

  static Vec<2> displacement(const Vec<2>& p) {
    const double x = p.x(), y = p.y();
    return {std::sin(pi * x) * std::cos(pi * y), 0.5 * x * x * y + std::cos(pi * x) * std::sin(pi * y)};
  }
  Voigt<2> stress(const Vec<2>& p) const {
    const double x = p.x(), y = p.y();
    const double cc = pi * std::cos(pi * x) * std::cos(pi * y), ss = pi * std::sin(pi * x) * std::sin(pi * y);
    return testing::hooke<2>({1.0, 0.3}, Plane::stress) * Voigt<2>(cc, 0.5 * x * x + cc, 0.0, x * y - 2.0 * ss);
  }
  Vec<2> body_force(const Vec<2>& p) const {
    const double x = p.x(), y = p.y(), l = lame.lambda, m = lame.mu;
    const double sc = pi * pi * std::sin(pi * x) * std::cos(pi * y), cs = pi * pi * std::cos(pi * x) * std::sin(pi * y);
    return {(2.0 * l + 2.0 * m) * sc - l * x - m * (x - 2.0 * sc), (2.0 * l + 2.0 * m) * cs - m * (y - 2.0 * cs)};
  }
};

Errors solve(double size, ApproximationOptions options, Essential essential) {
  const auto mesh = triangulate(shapes::l_shape(1.0), {.size = size});
  const std::vector<std::string> parts{"left", "bottom", "right", "top", "notch"};
  if (options.kind == BasisKind::mls && essential == Essential::strong) options.vanish_on = parts;
  const auto approximation = approximate(mesh, options);
  const ElasticModel model{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential};
  const Manufactured exact{plane_lame({1.0, 0.3}, Plane::stress)};
  std::vector<DisplacementCondition<2>> conditions;
  for (const auto& part : parts) conditions.push_back(testing::displacement<2>(part, Manufactured::displacement));
  const auto solution = ElasticSolver<2>(approximation, model, conditions).solve({{}, [&](const Vec<2>& x) {
                                                                                    return exact.body_force(x);
                                                                                  }});
  return errors_against<2>(approximation, recover_fields(approximation, solution), materials_of(model, mesh),
                           {Manufactured::displacement, [&](const Vec<2>& x) { return exact.stress(x); }});
}

class FiniteElements : public ::testing::TestWithParam<std::tuple<BasisKind, Essential>> {};

TEST_P(FiniteElements, ConvergeAtTheirOrder) {
  const auto [kind, essential] = GetParam();
  const auto coarse = solve(0.1, {.kind = kind}, essential), fine = solve(0.025, {.kind = kind}, essential);
  const double degree = kind == BasisKind::p1 ? 1.0 : 2.0;
  const double l2 = 0.5 * std::log2(*coarse.l2_displacement / *fine.l2_displacement);
  const double energy = 0.5 * std::log2(*coarse.energy_norm / *fine.energy_norm);
  EXPECT_NEAR(l2, degree + 1.0, 0.25);
  EXPECT_NEAR(energy, degree, 0.2);
}

INSTANTIATE_TEST_SUITE_P(Baselines, FiniteElements,
                         ::testing::Combine(::testing::Values(BasisKind::p1, BasisKind::p2),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param) == BasisKind::p1 ? "p1" : "p2") +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

class BodyForce : public ::testing::TestWithParam<std::tuple<SecondaryKind, Essential>> {};

TEST_P(BodyForce, ManufacturedSolutionConverges) {
  const auto [secondary, essential] = GetParam();
  const auto coarse = solve(0.2 / 6, {.spacing = 0.2, .secondary = secondary}, essential);
  const auto fine = solve(0.05 / 6, {.spacing = 0.05, .secondary = secondary}, essential);
  const double l2 = 0.5 * std::log2(*coarse.l2_displacement / *fine.l2_displacement);
  const double energy = 0.5 * std::log2(*coarse.energy_norm / *fine.energy_norm);
  EXPECT_GE(l2, 1.7);
  EXPECT_LE(l2, 3.0);
  // 1 is what functions of order 1 have; indicators' projection errors cancel a part, those of linear ones do not.
  EXPECT_GE(energy, secondary == SecondaryKind::linear ? 0.95 : 1.0);
  EXPECT_LE(energy, 1.8);
}

INSTANTIATE_TEST_SUITE_P(Secondary, BodyForce,
                         ::testing::Combine(::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(testing::name_of(std::get<0>(test.param))) +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

}  // namespace
}  // namespace efree
