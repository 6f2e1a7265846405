// SPDX-License-Identifier: GPL-3.0-or-later
// Pressures that follow the body.
#include "efree/assembly/follower_pressure.hpp"
#include "efree/bench/lame.hpp"
#include "efree/core/error.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/solvers/algorithms/newton.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solvers/fine_displacement.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

template <int Dim> FollowerPressure<Dim> uniform(std::string on, double pressure) {
  return {std::move(on), [pressure](const Vec<Dim>&) { return pressure; }};
}
template <int Dim> Loads<Dim> uniform_on(const std::vector<std::string>& parts, double pressure) {
  Loads<Dim> loads;
  for (const auto& part : parts) loads.followers.push_back(uniform<Dim>(part, pressure));
  return loads;
}
template <int Dim> std::vector<std::string> all_parts(const FineMesh<Dim>& mesh) {
  std::vector<std::string> parts;
  for (const auto& group : mesh.groups()) parts.push_back(group.name);
  return parts;
}
SharedMaterial soft() {
  return NeoHookean({.E = 1.0, .nu = 0.3});
}
/// Shear modulus 1, 5000 times as stiff against dilatation.
SharedMaterial rubber() {
  return NeoHookean({.E = 2.9998, .nu = 0.4999});
}

/// The tangent against derivatives of the residual at a random state: it is their symmetric part, and all where the
/// load has an energy.
template <int Dim>
void expect_derivatives(const NonlinearEquilibrium<Dim>& equations, bool has_energy, const std::string& name) {
  const auto unknowns = static_cast<Index>(equations.node_of_unknowns().size());
  const State at = equations.moved(equations.under(1.0, equations.rest()), 0.002 * Vector::Random(unknowns));
  SymmetricMatrix K;
  equations.tangent(at, K);
  const auto derivative = [&](const Vector& direction) -> Vector {
    constexpr double step = 2e-6;
    return (equations.residual(equations.moved(at, step * direction)) -
            equations.residual(equations.moved(at, -step * direction))) /
           (2.0 * step);
  };
  const Vector a = Vector::Random(unknowns), b = Vector::Random(unknowns);
  const Vector Da = derivative(a), Db = derivative(b), Kb = K.selfadjointView<Eigen::Lower>() * b;
  EXPECT_NEAR(a.dot(Kb), 0.5 * (a.dot(Db) + b.dot(Da)), 1e-7 * a.norm() * Kb.norm()) << name;
  const double largest = Kb.cwiseAbs().maxCoeff();
  EXPECT_LT((Kb + equations.not_in_tangent(at, b) - Db).cwiseAbs().maxCoeff(), 1e-7 * largest) << name;
  const double lacking = equations.not_in_tangent(at, b).cwiseAbs().maxCoeff();
  if (has_energy)
    EXPECT_LT(lacking, 1e-13 * largest) << name;
  else
    EXPECT_GT(lacking, 1e-6 * largest) << name << ": it is not symmetric";
}

TEST(FollowerPressure, StiffnessIsTheSymmetricPartOfTheDerivativeAndAllOfItWhereTheLoadHasAnEnergy) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.5, 1.0, 0.2), {.size = 0.2});
  const std::vector<DisplacementCondition<2>> springs{elastic_support<2>("outer", 1.0)};
  Loads<2> uneven;
  uneven.followers.push_back({"inner", [](const Vec<2>& x) { return 0.3 + x[0]; }});
  for (const Plane plane : {Plane::strain, Plane::stress})
    for (const bool quadratic : {false, true}) {
      const auto approximation = approximate(
          ring, {.order = quadratic ? 2 : 1, .spacing = quadratic ? 0.3 : 0.2, .dilatation = Dilatation::pointwise});
      const ElasticModel model{.material = soft(), .plane = plane};
      const auto equations = [&](const Loads<2>& loads) {
        return NonlinearEquilibrium<2>(approximation, model, Program<2>::grows(springs, loads));
      };
      expect_derivatives(equations(uniform_on<2>({"inner"}, 0.5)), true, "closed curve");
      expect_derivatives(equations(uniform_on<2>({"inner", "outer"}, 0.5)), true, "closed curves");
      expect_derivatives(equations(uneven), false, "pressure that varies");
    }
  const FineMesh<2> strip = triangulate(shapes::rectangle(0.5, 0, 2, 1), {.size = 0.25});
  for (const Plane plane : {Plane::strain, Plane::axisymmetric})
    for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
      const auto approximation = approximate(
          strip, {.kind = BasisKind::p2, .axisymmetric = plane == Plane::axisymmetric, .dilatation = dilatation});
      const auto equations = [&](const std::vector<DisplacementCondition<2>>& conditions) {
        return NonlinearEquilibrium<2>(approximation,
                                       {.material = soft(), .plane = plane, .essential = Essential::strong},
                                       Program<2>::grows(conditions, uniform_on<2>({"left"}, 0.5)));
      };
      expect_derivatives(equations({clamp<2>("bottom"), clamp<2>("top")}), true, "between parts that are held");
      expect_derivatives(equations({symmetry_plane<2>("bottom"), symmetry_plane<2>("top"), clamp<2>("right")}), true,
                         "between planes of symmetry");
      expect_derivatives(equations({clamp<2>("right")}), false, "between free edges");
    }
  const FineMesh<3> block(solids::box({1.0, 1.0, 1.0}, 0.4));
  const auto approximation = approximate<3>(block, {.spacing = 0.5});
  const auto equations = [&](const Loads<3>& loads) {
    return NonlinearEquilibrium<3>(approximation, {.material = soft()},
                                   Program<3>::grows({elastic_support<3>("bottom", 1.0)}, loads));
  };
  expect_derivatives(equations(uniform_on<3>(all_parts(block), 0.5)), true, "closed surface");
  expect_derivatives(equations(uniform_on<3>({"top"}, 0.5)), false, "between free edges in space");
}

/// sum of forces and moments of a uniform pressure all around, however the body is deformed.
template <int Dim> void expect_nothing_in_all(const Approximation<Dim>& approximation, const FineMesh<Dim>& mesh) {
  std::vector<FollowerPressure<Dim>> on;
  for (const auto& part : all_parts(mesh)) on.push_back(uniform<Dim>(part, 0.7));
  const FollowerPressures<Dim> pressures(approximation.space, approximation.shape, on);
  const Points<Dim> U = 0.05 * Points<Dim>::Random(Dim, approximation.shape.num_nodes());
  const Vector p = pressures.at_points(on);
  Resultant<Dim> all;
  double size = 0.0;
  for (const auto& [part, of] : pressures.resultants(p, U)) {
    all += of;
    size += of.force.norm();
  }
  const Vec<Dim> nodal = pressures.forces(p, U).rowwise().sum();
  if (approximation.space.axisymmetric()) {
    EXPECT_NEAR(all.force[1], 0.0, 1e-13 * size);
    EXPECT_NEAR(nodal[1], 0.0, 1e-13 * size);
    return;
  }
  EXPECT_LT(all.force.norm(), 1e-13 * size);
  EXPECT_LT(nodal.norm(), 1e-13 * size);
  EXPECT_LT(all.moment.norm(), 1e-13 * size);
}

TEST(FollowerPressure, AllAroundABodyItHasNoResultantHoweverTheBodyIsDeformed) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.5, 0, 2, 1), {.size = 0.25});
  for (const bool axisymmetric : {false, true}) {
    expect_nothing_in_all<2>(approximate(mesh, {.axisymmetric = axisymmetric, .spacing = 0.5}), mesh);
    expect_nothing_in_all<2>(approximate(mesh, {.kind = BasisKind::p2, .axisymmetric = axisymmetric}), mesh);
  }
  const FineMesh<3> block(solids::box({1.0, 1.0, 1.0}, 0.4));
  expect_nothing_in_all<3>(approximate<3>(block, {.spacing = 0.5}), block);
  expect_nothing_in_all<3>(approximate<3>(block, {.kind = BasisKind::p2}), block);
}

/// The stretch of a body under a pressure all around, by its energy: sigma = mu / J (l^2 - 1) + lambda ln(J) / J, with
/// J = l^dimensions (plane strain: 2).
double stretch_under(double p, int dimensions) {
  const double mu = 1.0 / 2.6, lambda = 0.3 / (1.3 * 0.4);
  double low = 0.1, high = 2.0;
  for (int k = 0; k < 100; ++k) {
    const double l = 0.5 * (low + high), J = std::pow(l, dimensions);
    (mu / J * (l * l - 1.0) + lambda * std::log(J) / J > -p ? high : low) = l;
  }
  return low;
}
template <int Dim> void expect_shrunk(const Approximation<Dim>& approximation, const ElasticModel& model,
                                      const std::vector<std::string>& planes, const std::vector<std::string>& pressed,
                                      int dimensions) {
  constexpr double p = 0.6;
  std::vector<DisplacementCondition<Dim>> conditions;
  for (const auto& plane : planes) conditions.push_back(symmetry_plane<Dim>(plane));
  const NonlinearEquilibrium<Dim> equations(approximation, model,
                                            Program<Dim>::grows(conditions, uniform_on<Dim>(pressed, p)));
  Cholesky linear;
  const State end = follow(equations, linear, equations.rest(), {.step = 0.5});
  const double l = stretch_under(p, dimensions);
  EXPECT_LT(l, 0.9);
  const Points<Dim> u = fine_displacement(approximation, end);
  EXPECT_LT((u - (l - 1.0) * approximation.space.points()).cwiseAbs().maxCoeff(), 1e-8);
  const auto fields = equations.fields(end);
  EXPECT_LT((fields.stress.row(0).array() + p).abs().maxCoeff(), 1e-8);
  // What is reported balances.
  std::vector<Resultant<Dim>> all;
  for (const auto& load : equations.applied(end)) {
    EXPECT_EQ(load.kind, "follower_pressure");
    all.push_back(load.of);
  }
  ASSERT_EQ(all.size(), pressed.size());
  if (!approximation.space.axisymmetric()) {
    EXPECT_NEAR(all.front().force.norm(), p * std::pow(l, Dim - 1), 1e-8) << "on the area as it is now";
  }
  for (const auto& [part, of] : equations.reactions(end)) all.push_back(of);
  EXPECT_LT(imbalance(all, 1.0, approximation.space.axisymmetric()), 1e-9);
}

TEST(FollowerPressure, ABodyUnderItAllAroundShrinksAsItsClosedForm) {
  const FineMesh<2> square = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.2});
  for (const ApproximationOptions& options :
       {ApproximationOptions{.spacing = 0.4}, {.order = 2, .spacing = 0.4}, {.kind = BasisKind::p1}})
    expect_shrunk<2>(approximate(square, options), {.material = soft(), .plane = Plane::strain}, {"left", "bottom"},
                     {"right", "top"}, 2);
  expect_shrunk<2>(approximate(square, {.axisymmetric = true, .spacing = 0.4}),
                   {.material = soft(), .plane = Plane::axisymmetric}, {"bottom"}, {"right", "top"}, 3);
  const FineMesh<3> cube(solids::box({1.0, 1.0, 1.0}, 0.4));
  expect_shrunk<3>(approximate<3>(cube, {.spacing = 0.5}), {.material = soft()}, {"left", "front", "bottom"},
                   {"right", "back", "top"}, 3);
}

/// Pressure that inflates an incompressible neo-Hookean wall of shear modulus 1, radii 1 and 2, to the inner stretch l:
/// the integral of (hoop - radial stress) dr / r (2 dr / r of a sphere) through the wall (Green & Zerna 1954, chapter
/// 3).
double inflating(double l, bool sphere) {
  if (!sphere) {
    const double out = std::sqrt(0.25 * (l * l - 1.0) + 1.0);
    return std::log(l / out) + 0.5 * (1.0 / (out * out) - 1.0 / (l * l));
  }
  const double out = std::cbrt(0.125 * (l * l * l - 1.0) + 1.0);
  const auto of = [](double x) { return 2.0 / x + 0.5 / std::pow(x, 4); };
  return of(out) - of(l);
}
/// Mean stretch of the inner wall.
double inner_stretch(const Approximation<2>& approximation, const State& state) {
  const Points<2> u = fine_displacement(approximation, state);
  const auto& mesh = approximation.space.mesh();
  double sum = 0.0, length = 0.0;
  for (const Index f : mesh.group("inner"))
    for (const Index v : mesh.facets().col(f)) {
      sum += 0.5 * mesh.facet_measure(f) * u.col(v).dot(mesh.vertex(v).normalized());
      length += 0.5 * mesh.facet_measure(f);
    }
  return 1.0 + sum / length;
}
/// Residuals that fall like squares down to rounding.
void expect_quadratic(const Converged& step) {
  const auto& r = step.residuals;
  for (std::size_t k = 1; k < r.size(); ++k)
    if (r[k - 1] < 1e-6 && r[k] > 1e-10) {
      EXPECT_LT(r[k], 1e4 * r[k - 1] * r[k - 1]) << "at " << step.state.time;
    }
}

TEST(FollowerPressure, InflatesAThickRubberTubeAsItsClosedForm) {
  const bench::ThickWall slice{false};
  PlanarDomain quarter;
  {
    std::vector<Vec<2>> inner, outer;
    for (int k = 0; k <= 32; ++k) {
      const double angle = 0.5 * std::numbers::pi * k / 32;
      const Vec<2> n = k == 32 ? Vec<2>(0.0, 1.0) : Vec<2>(std::cos(angle), std::sin(angle));
      outer.push_back(2.0 * n);
      inner.insert(inner.begin(), n);
    }
    quarter.boundary = {{"bottom", {{1, 0}, {2, 0}}}, {"outer", outer}, {"left", {{0, 2}, {0, 1}}}, {"inner", inner}};
  }
  const FineMesh<2> across = triangulate(quarter, {.size = 0.06}),
                    along = triangulate(slice.section(0.25, 0.04), {.size = 0.04});
  for (const bool axisymmetric : {true, false}) {
    const auto approximation =
        approximate(axisymmetric ? along : across,
                    {.axisymmetric = axisymmetric, .spacing = 0.125, .dilatation = Dilatation::averaged});
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = rubber(), .plane = axisymmetric ? Plane::axisymmetric : Plane::strain},
        Program<2>::grows({symmetry_plane<2>("bottom"), symmetry_plane<2>(axisymmetric ? "top" : "left")},
                          uniform_on<2>({"inner"}, 0.55)));
    Cholesky linear;
    std::vector<double> stretches;
    follow(equations, linear, equations.rest(), {.step = 0.1}, [&](const PathStep& step) {
      stretches.push_back(inner_stretch(approximation, step.now.state));
      const double p = 0.55 * step.now.state.time;
      EXPECT_NEAR(inflating(stretches.back(), false), p, 0.01 * p) << stretches.back();
      expect_quadratic(step.now);
    });
    EXPECT_GT(stretches.back(), 1.85);
  }
}

/// A balloon: the pressure has a maximum at a stretch of 1.8, and falls.
TEST(FollowerPressure, InflatesAThickRubberSpherePastItsLargestPressure) {
  const bench::ThickWall wall{true};
  const FineMesh<2> section = triangulate(wall.section(0.0, 0.06), {.size = 0.06});
  const auto approximation =
      approximate(section, {.axisymmetric = true, .spacing = 0.1, .dilatation = Dilatation::averaged});
  const NonlinearEquilibrium<2> equations(
      approximation, {.material = rubber(), .plane = Plane::axisymmetric},
      Program<2>::grows({symmetry_plane<2>("bottom")}, uniform_on<2>({"inner"}, 1.0)));
  std::vector<double> stretches, pressures;
  std::vector<Index> falling;
  Cholesky linear;
  const PathOptions options{.control = Control::arc_length, .step = 0.1, .max_step = 1.0, .max_steps = 30};
  EXPECT_THAT(
      [&] {
        follow(equations, linear, equations.rest(), options, [&](const PathStep& step) {
          stretches.push_back(inner_stretch(approximation, step.now.state));
          pressures.push_back(step.now.state.time);
          falling.push_back(step.now.negative_pivots);
          EXPECT_NEAR(inflating(stretches.back(), true), pressures.back(), 0.01 * pressures.back()) << stretches.back();
        });
      },
      ThrowsMessage<PathError>(HasSubstr("after 30 steps")));
  EXPECT_GT(stretches.back(), 2.5);
  EXPECT_EQ(falling.front(), 0);
  EXPECT_EQ(falling.back(), 1) << "the pressure falls";
}

/// A strip that is bent by a pressure on one side, which ends at a free edge.
TEST(FollowerPressure, RollsAStripUpThoughItsStiffnessIsNotSymmetric) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 10, 1), {.size = 0.2});
  const auto approximation = approximate(mesh, {.order = 2, .spacing = 0.5});
  const NonlinearEquilibrium<2> equations(approximation, {.material = soft(), .plane = Plane::strain},
                                          Program<2>::grows({clamp<2>("left")}, uniform_on<2>({"top"}, 0.01)));
  Cholesky linear;
  std::vector<int> iterations;
  const State end = follow(equations, linear, equations.rest(), {.step = 0.1}, [&](const PathStep& step) {
    iterations.push_back(step.now.iterations());
    expect_quadratic(step.now);
  });
  EXPECT_LE(iterations.back(), 5);
  const Points<2> u = fine_displacement(approximation, end);
  EXPECT_LT(u.row(0).minCoeff(), -11.0) << "its end is far behind where it is held";
  const auto load = equations.applied(end).front().of, reaction = equations.reactions(end).at("left");
  EXPECT_LT(imbalance<2>({load, reaction}, 10.0), 1e-9);
}

TEST(FollowerPressure, IsForBodiesOfFiniteStrainsAndForSteps) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.spacing = 0.5});
  const auto equations = [&](const SharedMaterial& material, const Loads<2>& loads) {
    NonlinearEquilibrium<2>(approximation, {.material = material, .plane = Plane::strain},
                            Program<2>::grows({clamp<2>("left")}, loads));
  };
  const SharedMaterial linear = LinearElastic(1.0, 0.3);
  EXPECT_THAT([&] { equations(linear, uniform_on<2>({"right"}, 1.0)); },
              ThrowsMessage<InputError>(HasSubstr("pressure on \"right\" follows the body: that is for materials of "
                                                  "finite strains")));
  EXPECT_THAT([&] { equations(soft(), uniform_on<2>({"roof"}, 1.0)); }, ThrowsMessage<InputError>(HasSubstr("roof")));
  Loads<2> wrong;
  wrong.followers.push_back({"right", [](const Vec<2>& x) { return std::exp(1e3 + x[1]); }});
  const NonlinearEquilibrium<2> nan(approximation, {.material = soft(), .plane = Plane::strain},
                                    Program<2>::grows({clamp<2>("left")}, wrong));
  EXPECT_THAT([&] { nan.residual(nan.under(1.0, nan.rest())); },
              ThrowsMessage<InputError>(HasSubstr("pressure on \"right\" is inf at (1, ")));
  EXPECT_THAT([&] { load_vector(approximation.space, approximation.shape, uniform_on<2>({"right"}, 1.0)); },
              ThrowsMessage<InputError>(HasSubstr("taken to be at rest")));
}

}  // namespace
}  // namespace efree
