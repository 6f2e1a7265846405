// SPDX-License-Identifier: GPL-3.0-or-later
// Bodies at finite strains, and materials with memory, by Newton's method.
#include "efree/bench/layers.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/drucker_prager.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/solvers/algorithms/newton.hpp"
#include "efree/solvers/equations/nonlinear_equilibrium.hpp"
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/tests/bodies.hpp"
#include "efree/tests/solvers/fine_displacement.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// W = mu/2 (tr C - 3 - 2 ln J) + lambda/2 (ln J)^2.
class NeoHooke final : public Material {
 public:
  NeoHooke(double lambda, double mu) : lambda_(lambda), mu_(mu) {}
  bool homogeneous() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override {
    for (Index p = 0; p < deformation.size(); ++p) {
      const Mat<3> F = deformation.gradient(p);
      const double J = F.determinant();
      if (!(J > 0.0)) throw NumericalError("J is not positive");
      const Mat<3> inverse = F.inverse(), g = inverse.transpose();
      const double log = std::log(J);
      response.stress(p) = mu_ * (F - g) + lambda_ * log * g;
      response.energy[p] = 0.5 * mu_ * (F.squaredNorm() - 3.0 - 2.0 * log) + 0.5 * lambda_ * log * log;
      if (!response.tangent) continue;
      for (int l = 0; l < 9; ++l) {
        Mat<3> dF = Mat<3>::Zero();
        dF(l % 3, l / 3) = 1.0;
        const Mat<3> dg = -g * dF.transpose() * g;
        const Mat<3> dP = mu_ * (dF - dg) + lambda_ * (g.cwiseProduct(dF).sum() * g + log * dg);
        response.tangent_at(p).col(l) = dP.reshaped();
      }
    }
  }

 private:
  double lambda_, mu_;
};

struct Variant {
  std::string name;
  ApproximationOptions options;
  Essential essential = Essential::nitsche;
};
std::vector<Variant> variants(double spacing) {
  return {{"cells", {.spacing = spacing, .dilatation = Dilatation::pointwise}},
          {"averaged", {.spacing = spacing, .dilatation = Dilatation::averaged}},
          {"linear", {.spacing = spacing, .secondary = SecondaryKind::linear, .dilatation = Dilatation::pointwise}},
          {"quadratic, averaged",
           {.order = 2, .spacing = spacing, .secondary = SecondaryKind::linear, .dilatation = Dilatation::averaged}},
          {"second cloud", {.spacing = spacing, .secondary = SecondaryKind::mls, .dilatation = Dilatation::pointwise}},
          {"linear elements, weakly", {.kind = BasisKind::p1, .dilatation = Dilatation::pointwise}},
          {"quadratic elements, nodal values",
           {.kind = BasisKind::p2, .dilatation = Dilatation::averaged},
           Essential::strong}};
}

template <int Dim> DisplacementCondition<Dim> prescribed(std::string on, const Mat<Dim>& H) {
  DisplacementCondition<Dim> condition{std::move(on), {}, {}};
  for (int i = 0; i < Dim; ++i) condition.components[i] = [H, i](const Vec<Dim>& x) { return (H * x)[i]; };
  return condition;
}
template <int Dim> std::vector<DisplacementCondition<Dim>> everywhere(const FineMesh<Dim>& mesh, const Mat<Dim>& H) {
  std::vector<DisplacementCondition<Dim>> conditions;
  for (const auto& group : mesh.groups()) conditions.push_back(prescribed<Dim>(group.name, H));
  return conditions;
}
template <int Dim>
Converged solved(const NonlinearEquilibrium<Dim>& equations, double time = 1.0, const NewtonOptions& options = {}) {
  Cholesky linear;
  TangentSolver tangent(equations, linear);
  return newton(equations, tangent, equations.rest(), time, options);
}

/// Directional derivative of the residual against the tangent, at a random state around a deformed one.
template <int Dim> void expect_tangent_is_derivative(const NonlinearEquilibrium<Dim>& equations, const State& around,
                                                     double amplitude, const std::string& name) {
  const auto unknowns = static_cast<Index>(equations.node_of_unknowns().size());
  const State state = equations.moved(around, amplitude * Vector::Random(unknowns));
  SymmetricMatrix K;
  equations.tangent(state, K);
  const Vector direction = Vector::Random(unknowns);
  const double step = 1e-5 * amplitude / 0.02;
  const Vector derivative = (equations.residual(equations.moved(state, step * direction)) -
                             equations.residual(equations.moved(state, -step * direction))) /
                            (2.0 * step);
  Vector product = K.selfadjointView<Eigen::Lower>() * direction;
  if (const Vector lacking = equations.not_in_tangent(state, direction); lacking.size() > 0) product += lacking;
  EXPECT_LT((product - derivative).cwiseAbs().maxCoeff(), 1e-7 * product.cwiseAbs().maxCoeff()) << name;
}

TEST(NonlinearEquilibrium, TangentIsTheDerivativeOfTheResidualInThePlane) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  const Mat<2> H{{0.2, 0.1}, {0.05, -0.1}};
  for (const Plane plane : {Plane::strain, Plane::stress})
    for (auto [name, options, essential] : variants(0.6)) {
      if (plane == Plane::stress) options.dilatation = Dilatation::pointwise;
      const auto approximation = approximate(mesh, options);
      const NonlinearEquilibrium<2> equations(
          approximation, {.material = NeoHooke(1.3, 0.7), .plane = plane, .essential = essential},
          Program<2>::grows({prescribed<2>("left", H), {"right", {[](const Vec<2>&) { return 0.3; }}, {}}}));
      expect_tangent_is_derivative(equations, equations.under(0.1, equations.rest()), 0.005, name);
    }
}

TEST(NonlinearEquilibrium, BodiesOfFiniteStrainsThatAreTurnedInsideOutAreNoAnswer) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.spacing = 0.6, .dilatation = Dilatation::pointwise});
  const auto check = [&](const SharedMaterial& material, double stretch) {
    const NonlinearEquilibrium<2> equations(approximation, {.material = material, .plane = Plane::strain},
                                            Program<2>::grows({clamp<2>("left")}));
    State state = equations.rest();
    for (Index I = 0; I < static_cast<Index>(approximation.nodes.cols()); ++I)
      state.u[2 * I] = (stretch - 1.0) * approximation.nodes(0, I);
    equations.check(state);
  };
  EXPECT_NO_THROW(check(NeoHooke(1.3, 0.7), 0.1));
  EXPECT_THAT([&] { check(NeoHooke(1.3, 0.7), -0.1); },
              ThrowsMessage<NumericalError>(HasSubstr("the body is turned inside out at (")));
  EXPECT_NO_THROW(check(LinearElastic(ElasticModuli{.E = 1.0, .nu = 0.3}), -0.1)) << "small strains know no volumes";
}

TEST(NonlinearEquilibrium, TangentIsTheDerivativeOfTheResidualInBodiesOfRevolutionAndInSpace) {
  const FineMesh<2> section = triangulate(shapes::rectangle(0.5, 0, 2, 1), {.size = 0.25});
  for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
    const auto approximation = approximate(section, {.axisymmetric = true, .spacing = 0.6, .dilatation = dilatation});
    const NonlinearEquilibrium<2> equations(approximation,
                                            {.material = NeoHooke(1.3, 0.7), .plane = Plane::axisymmetric},
                                            Program<2>::grows({clamp<2>("bottom")}));
    expect_tangent_is_derivative(equations, equations.rest(), 0.01, "axisymmetric");
  }
  const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, 0.3));
  for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
    const auto approximation = approximate<3>(mesh, {.spacing = 0.5, .dilatation = dilatation});
    const NonlinearEquilibrium<3> equations(
        approximation, {.material = NeoHooke(1.3, 0.7)},
        Program<3>::grows({clamp<3>("left"), {"right", {}, [](const Vec<3>&) { return 0.1; }}}));
    expect_tangent_is_derivative(equations, equations.under(1.0, equations.rest()), 0.005, "solid");
  }
}

/// Soil that keeps its volume where friction would have it swell.
SharedMaterial soil(Strain strain, double dilatancy = 0.0) {
  return DruckerPrager({.moduli = {.E = 1000.0, .nu = 0.3},
                        .cohesion = Hardening::linear(1.0, 20.0),
                        .friction = 0.6,
                        .dilatancy = dilatancy,
                        .strain = strain});
}

TEST(NonlinearEquilibrium, TangentAndWhatItLacksAreTheDerivativeWhereFlowIsNotAssociated) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.25});
  const FineMesh<3> block(solids::box({1.0, 1.0, 1.0}, 0.3));
  const Mat<2> H{{0.0, 0.1}, {0.0, -0.05}};
  const Mat<3> G{{0.0, 0.0, 0.1}, {0.0, 0.0, 0.0}, {0.0, 0.0, -0.05}};
  for (const Strain strain : {Strain::small, Strain::finite})
    for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
      const auto plane = approximate(mesh, {.spacing = 0.6, .dilatation = dilatation});
      const NonlinearEquilibrium<2> in_plane(plane, {.material = soil(strain), .plane = Plane::strain},
                                             Program<2>::grows(everywhere(mesh, H)));
      expect_tangent_is_derivative(in_plane, solved(in_plane).state, 1e-4, "plane");
      const auto space = approximate<3>(block, {.spacing = 0.5, .dilatation = dilatation});
      const NonlinearEquilibrium<3> in_space(space, {.material = soil(strain)},
                                             Program<3>::grows(everywhere(block, G)));
      expect_tangent_is_derivative(in_space, solved(in_space).state, 1e-4, "space");
    }
}

/// Dilatations that deviate from the mean of a patch shear metal out of the plane; together with all else it flows.
TEST(NonlinearEquilibrium, TangentIsTheDerivativeWhereMetalFlowsAndDilatationsAreAveraged) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.5, 0, 2, 1), {.size = 0.25});
  const Mat<2> H{{0.0, 0.1}, {0.0, -0.05}};
  for (const Plane plane : {Plane::strain, Plane::axisymmetric})
    for (const Strain strain : {Strain::small, Strain::finite}) {
      const SharedMaterial metal = J2({.moduli = {.E = 1000.0, .nu = 0.3}, .yield = 2.0, .strain = strain});
      const auto approximation = approximate(
          mesh, {.axisymmetric = plane == Plane::axisymmetric, .spacing = 0.4, .dilatation = Dilatation::averaged});
      const NonlinearEquilibrium<2> equations(
          approximation, {.material = metal, .plane = plane},
          Program<2>::grows({prescribed<2>("bottom", Mat<2>::Zero()), prescribed<2>("top", H)}));
      const State state = solved(equations, 0.5).state;
      ASSERT_GT(equations.fields(state).dissipated.maxCoeff(), 0.0);
      expect_tangent_is_derivative(equations, equations.under(0.6, equations.commit(state)), 1e-4,
                                   plane == Plane::strain ? "plane strain" : "axisymmetric");
    }
}

TEST(PlasticFlow, SoilThatDoesNotSwellTakesOneMoreIterationInAStepThanSoilThatDoes) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.1});
  const auto approximation = approximate(mesh, {.spacing = 0.25, .dilatation = Dilatation::averaged});
  std::vector<int> iterations;
  int steps = 0;
  for (const double dilatancy : {0.6, 0.0}) {
    auto pressed = clamp<2>("top");
    pressed.components[1] = [](const Vec<2>&) { return -0.03; };
    const NonlinearEquilibrium<2> equations(approximation,
                                            {.material = soil(Strain::small, dilatancy), .plane = Plane::strain},
                                            Program<2>::grows({clamp<2>("bottom"), pressed}));
    Cholesky linear;
    int& all = iterations.emplace_back(0);
    steps = 0;
    follow(equations, linear, equations.rest(), {.step = 0.1}, [&](const PathStep& step) {
      all += step.now.iterations();
      ++steps;
    });
    EXPECT_LE(steps, 12);
  }
  // What is not symmetric of its tangent is left to iterations (not_in_tangent).
  EXPECT_LE(iterations[1], iterations[0] + steps);
}

TEST(NonlinearEquilibrium, FiniteAffineMotionsAreExactInThePlane) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.2});
  const Mat<2> H{{0.6, 0.5}, {-0.2, -0.3}};
  for (const auto& [name, options, essential] : variants(0.5)) {
    const auto approximation = approximate(mesh, options);
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain, .essential = essential},
        Program<2>::grows(everywhere(mesh, H)));
    const auto result = solved(equations);
    const Points<2> u = fine_displacement(approximation, result.state);
    for (Index v = 0; v < mesh.num_vertices(); ++v) ASSERT_LT((u.col(v) - H * mesh.vertex(v)).norm(), 1e-9) << name;
    Mat<3> F = Mat<3>::Identity();
    F.topLeftCorner<2, 2>() += H;
    const auto exact = respond(NeoHooke(1.3, 0.7), {Points<3>::Zero(3, 1), F.reshaped(), Matrix(0, 1)}, false);
    const auto fields = equations.fields(result.state);
    const Mat<3> sigma = Mat<3>(exact.P.reshaped(3, 3)) * F.transpose() / F.determinant();
    const Voigt<2> cauchy{sigma(0, 0), sigma(1, 1), sigma(2, 2), sigma(0, 1)};
    EXPECT_LT((fields.stress.colwise() - cauchy).cwiseAbs().maxCoeff(), 1e-8) << name;
    EXPECT_NEAR(equations.energy(result.state), 2.0 * exact.energy[0], 1e-8) << name;
  }
}

TEST(NonlinearEquilibrium, FiniteAffineMotionsAreExactInSpaceAndThroughTies) {
  const Mat<3> H{{0.3, 0.2, 0.0}, {-0.1, -0.2, 0.3}, {0.1, 0.0, 0.2}};
  const FineMesh<3> mesh(solids::box({1.0, 1.0, 1.0}, 0.3));
  for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
    const auto approximation = approximate<3>(mesh, {.spacing = 0.5, .dilatation = dilatation});
    const NonlinearEquilibrium<3> equations(approximation, {.material = NeoHooke(1.3, 0.7)},
                                            Program<3>::grows(everywhere(mesh, H)));
    const Points<3> u = fine_displacement(approximation, solved(equations).state);
    for (Index v = 0; v < mesh.num_vertices(); ++v) ASSERT_LT((u.col(v) - H * mesh.vertex(v)).norm(), 1e-9);
  }
}

TEST(NonlinearEquilibrium, RigidTurnsMakeNoStressAndNoEnergy) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.2});
  const double angle = 2.0;  // in steps
  Program<2> program;
  program.loads = [](double) { return Loads<2>{}; };
  program.conditions = [&](double t) {
    return std::vector{prescribed<2>("left", Eigen::Rotation2Dd(angle * t).toRotationMatrix() - Mat<2>::Identity())};
  };
  for (const Dilatation dilatation : {Dilatation::pointwise, Dilatation::averaged}) {
    const auto approximation = approximate(mesh, {.spacing = 0.5, .dilatation = dilatation});
    const NonlinearEquilibrium<2> equations(approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain},
                                            program);
    Cholesky linear;
    const State end = follow(equations, linear, equations.rest(), {.step = 0.2});
    const Mat<2> H = Eigen::Rotation2Dd(angle).toRotationMatrix() - Mat<2>::Identity();
    const Points<2> u = fine_displacement(approximation, end);
    for (Index v = 0; v < mesh.num_vertices(); ++v) ASSERT_LT((u.col(v) - H * mesh.vertex(v)).norm(), 1e-8);
    EXPECT_LT(equations.fields(end).stress.cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LT(equations.energy(end), 1e-16);
  }
}

/// A block between sliding planes: P_yy = 0 gives the stretch across, P_xx the force.
TEST(NonlinearEquilibrium, ConvergesQuadraticallyToTheClosedFormOfASlidingBlock) {
  const double lambda = 1.3, mu = 0.7, stretch = 1.8;
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.2});
  double b = 1.0;  // mu (b - 1/b) + lambda ln(a b) / b = 0
  for (int k = 0; k < 50; ++k) {
    const double f = mu * (b - 1.0 / b) + lambda * std::log(stretch * b) / b;
    const double df = mu * (1.0 + 1.0 / (b * b)) + lambda * (1.0 - std::log(stretch * b)) / (b * b);
    b -= f / df;
  }
  const double P = mu * (stretch - 1.0 / stretch) + lambda * std::log(stretch * b) / stretch;
  for (const auto& [name, options, essential] : variants(0.5)) {
    const auto approximation = approximate(mesh, options);
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = NeoHooke(lambda, mu), .plane = Plane::strain, .essential = essential},
        Program<2>::grows({symmetry_plane<2>("left"), symmetry_plane<2>("bottom"), {"right", {}, [=](const Vec<2>&) {
                                                                                      return 2.0 * (stretch - 1.0);
                                                                                    }}}));
    const auto result = solved(equations);
    const Points<2> u = fine_displacement(approximation, result.state);
    for (Index v = 0; v < mesh.num_vertices(); ++v) {
      const Vec<2> x = mesh.vertex(v);
      ASSERT_LT((u.col(v) - Vec<2>((stretch - 1.0) * x[0], (b - 1.0) * x[1])).norm(), 1e-8) << name;
    }
    const auto reactions = equations.reactions(result.state);
    EXPECT_NEAR(reactions.at("right").force[0], P, 1e-8) << name;
    EXPECT_NEAR(reactions.at("left").force[0], -P, 1e-8) << name;
    EXPECT_NEAR(reactions.at("left").moment[0] + reactions.at("right").moment[0] + reactions.at("bottom").moment[0],
                0.0, 1e-9)
        << name;
    EXPECT_LT(result.iterations(), 9) << name;
    const auto& r = result.residuals;
    for (std::size_t k = 1; k < r.size(); ++k)
      if (r[k - 1] < 0.01 && r[k] > 1e-13) {
        EXPECT_LT(r[k], 100.0 * r[k - 1] * r[k - 1]) << name;
      }
  }
}

TEST(NonlinearEquilibrium, ReactionsBalanceDeadLoadsAlsoInMomentsWhereForcesAreNow) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 4, 1), {.size = 0.2});
  for (const auto& [name, options, essential] : variants(0.5)) {
    const auto approximation = approximate(mesh, options);
    const Vec<2> t(0.0, -0.01);
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain, .essential = essential},
        Program<2>::grows({clamp<2>("left")},
                          {.tractions = {{"right", [t](const Vec<2>&, const Vec<2>&) { return t; }}}}));
    Cholesky linear;
    const State end = follow(equations, linear, equations.rest(), {.step = 0.25});
    const auto reaction = equations.reactions(end).at("left");
    EXPECT_LT((reaction.force + t).norm(), 1e-10) << name;
    // Where the load is now.
    const Points<2> u = fine_displacement(approximation, end);
    double arm = 0.0;
    const auto& space = approximation.space;
    for (const Index f : mesh.group("right"))
      for (Index g = 0; g < space.facet_rule().weights.size(); ++g) {
        const auto at = space.facet_point(f, space.facet_rule().points.col(g));
        const Index c = mesh.facet_cell(f);
        const auto N = space.values(at);
        double x = space.position(c, at)[0];
        for (std::size_t i = 0; i < space.cell(c).size(); ++i) x += N[i] * u(0, space.cell(c)[i]);
        arm += x * mesh.facet_measure(f) * space.facet_rule().weights[g];
      }
    EXPECT_LT(arm, 3.95) << name << ": the beam is bent";
    EXPECT_NEAR(reaction.moment[0], -arm * t[1], 1e-9) << name;
  }
}

TEST(NonlinearEquilibrium, ReactionsBalanceInMomentsWhereTheHeldPartsHaveMovedTo) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 4, 1), {.size = 0.2});
  for (const auto& [name, options, essential] : variants(0.5)) {
    const auto approximation = approximate(mesh, options);
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain, .essential = essential},
        Program<2>::grows({clamp<2>("left"),
                           {"right", {[](const Vec<2>&) { return -0.2; }, [](const Vec<2>&) { return 1.0; }}, {}}}));
    Cholesky linear;
    const auto reactions = equations.reactions(follow(equations, linear, equations.rest(), {.step = 0.25}));
    const auto &left = reactions.at("left"), &right = reactions.at("right");
    EXPECT_GT(right.moment.norm(), 0.01) << name;
    EXPECT_LT((left.force + right.force).norm(), 1e-9 * right.force.norm()) << name;
    EXPECT_LT((left.moment + right.moment).norm(), 1e-9 * right.moment.norm()) << name;
  }
}

/// A soft layer on a block 1e10 times as stiff, where all forces are small against those that the block would have.
TEST(NonlinearEquilibrium, SoftPartsBesideStiffOnesAreSolvedAsExactlyAsAlone) {
  const FineMesh<2> mesh(cut_regions(bench::layers({0.0, 0.0}, {1.0, 1.0}, 1, {0.5}, 0.1)));
  const auto approximation = approximate(mesh, {.spacing = 0.25});
  const NonlinearEquilibrium<2> equations(
      approximation,
      {.material = {}, .plane = Plane::strain, .regions = {NeoHooke(1.3e10, 0.7e10), NeoHooke(1.3, 0.7)}},
      Program<2>::grows(
          {clamp<2>("bottom"), {"top", {[](const Vec<2>&) { return 0.2; }, [](const Vec<2>&) { return -0.1; }}, {}}}));
  Cholesky linear;
  const State end = follow(equations, linear, equations.rest(), {.step = 0.5});
  const Vector residual = equations.residual(end);
  EXPECT_GT(equations.reactions(end).at("top").force.norm(), 0.5);
  double out = 0.0;
  for (Index i = 0; i < residual.size(); ++i)
    if (approximation.nodes(1, equations.node_of_unknowns()[i]) > 0.7) out = std::max(out, std::abs(residual[i]));
  EXPECT_LT(out, 1e-10);
}

/// Gradients are small differences of large displacements there: what is out of balance by rounding is in balance.
TEST(NonlinearEquilibrium, BodiesAreCarriedFarAway) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.1});
  const auto far = [](const Vec<2>&) { return 1e4; };
  const auto none = [](const Vec<2>&) { return 0.0; };
  for (const auto& [name, options, essential] : variants(0.2)) {
    const auto approximation = approximate(mesh, options);
    const NonlinearEquilibrium<2> equations(
        approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain, .essential = essential},
        Program<2>::grows({{"bottom", {far, none}, {}}, {"top", {far, [](const Vec<2>&) { return 0.1; }}, {}}}));
    Cholesky linear;
    int iterations = 0;
    follow(equations, linear, equations.rest(), {.step = 0.5},
           [&](const PathStep& step) { iterations += step.now.iterations(); });
    EXPECT_LT(iterations, 10) << name;
  }
}

TEST(NonlinearPath, StepsAreCutWhereTheyDoNotConvergeAndGrowWhereTheyDo) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.2});
  const auto approximation = approximate(mesh, {.spacing = 0.4});
  const NonlinearEquilibrium<2> equations(
      approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain},
      Program<2>::grows(
          {clamp<2>("left"), {"right", {[](const Vec<2>&) { return -0.7; }, [](const Vec<2>&) { return 0.0; }}, {}}}));
  Cholesky linear;
  std::vector<double> times{0.0};
  follow(equations, linear, equations.rest(), {.step = 1.0, .newton = {.max_iterations = 6}},
         [&](const PathStep& step) { times.push_back(step.after.time); });
  EXPECT_EQ(times.back(), 1.0);
  EXPECT_GT(times.size(), 2u);
  EXPECT_THAT(
      [&] {
        follow(equations, linear, equations.rest(), {.step = 0.5, .min_step = 0.3, .newton = {.max_iterations = 1}});
      },
      ThrowsMessage<PathError>(HasSubstr("does not converge")));
}

TEST(NonlinearPath, GoesOnFromASavedStateToTheSameEndBitForBit) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.2});
  const auto approximation = approximate(mesh, {.spacing = 0.4});
  const auto equations = [&] {
    return NonlinearEquilibrium<2>(
        approximation, {.material = NeoHooke(1.3, 0.7), .plane = Plane::strain},
        Program<2>::grows({clamp<2>("left"), {"right", {[](const Vec<2>&) { return 0.7; }}, {}}}));
  };
  std::vector<PathPoint> points;
  const auto all = equations();
  for (const int threads : {1, 2}) {
    set_num_threads(threads);
    Cholesky linear;
    std::vector<PathPoint> again;
    follow(all, linear, all.rest(), {.step = 0.1, .min_step = 1e-3},
           [&](const PathStep& step) { again.push_back(step.after); });
    if (threads == 2) {
      EXPECT_TRUE(again == points);
    }
    points = again;
  }
  ASSERT_GT(points.size(), 3u);
  const auto resumed = equations();
  Cholesky linear;
  const PathOptions options{.step = 0.1, .min_step = 1e-3};
  EXPECT_TRUE(follow(resumed, linear, points[2], options) == points.back());
  EXPECT_TRUE(follow(resumed, linear, points.back(), options) == points.back()) << "nothing is left to do";
}

TEST(NonlinearPath, GoesOnAlongTheSameArcBitForBitAlsoBeyondTheLargestLoad) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.spacing = 0.5});
  const auto equations = [&] {
    return NonlinearEquilibrium<2>(
        approximation, {.material = Hencky({.E = 1.0, .nu = 0.0}), .plane = Plane::strain},
        Program<2>::grows({symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                          {.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(1.0, 0.0); }}}}));
  };
  const PathOptions options{.control = Control::arc_length, .step = 0.1, .max_step = 0.3, .max_steps = 16};
  const auto path = [&](const PathPoint& from) {
    std::vector<PathPoint> points;
    const auto problem = equations();
    Cholesky linear;
    EXPECT_THROW(follow(problem, linear, from, options, [&](const PathStep& step) { points.push_back(step.after); }),
                 PathError);
    return points;
  };
  const auto whole = path(equations().rest());
  ASSERT_EQ(whole.size(), 16u);
  EXPECT_LT(whole[15].time, whole[12].time) << "the load falls";
  for (const std::size_t k : {0u, 7u, 13u}) EXPECT_TRUE(path(whole[k]).back() == whole.back()) << k;
}

/// Hencky's material without lateral strain bears no more than E / e, at a stretch of e: P = E ln(l) / l.
TEST(NonlinearPath, ArcLengthGoesPastTheLargestLoadThatAMaterialBears) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.25});
  const auto approximation = approximate(mesh, {.spacing = 0.5});
  const double largest = 1.0 / std::numbers::e;
  const NonlinearEquilibrium<2> equations(
      approximation, {.material = Hencky({.E = 1.0, .nu = 0.0}), .plane = Plane::strain},
      Program<2>::grows({symmetry_plane<2>("left"), symmetry_plane<2>("bottom")},
                        {.tractions = {{"right", [](const Vec<2>&, const Vec<2>&) { return Vec<2>(1.0, 0.0); }}}}));
  std::vector<double> stretches;
  const auto path = [&](Control control) {
    Cholesky linear;
    stretches.clear();
    follow(equations, linear, equations.rest(), {.control = control, .step = 0.1, .max_step = 0.3, .max_steps = 25},
           [&](const PathStep& step) {
             const Points<2> u = fine_displacement(approximation, step.now.state);
             stretches.push_back(1.0 + u.row(0).maxCoeff());
             const double l = stretches.back();
             EXPECT_NEAR(step.now.state.time, std::log(l) / l, 1e-8);
             EXPECT_EQ(step.now.negative_pivots > 0, l > std::numbers::e) << l;
           });
  };
  EXPECT_THAT([&] { path(Control::load); }, ThrowsMessage<PathError>(HasSubstr("limit load reached at t = 0.367")));
  EXPECT_NEAR(std::log(stretches.back()) / stretches.back(), largest, 1e-3 * largest);
  EXPECT_THAT([&] { path(Control::arc_length); }, ThrowsMessage<PathError>(HasSubstr("after 25 steps")));
  EXPECT_GT(stretches.back(), 4.0);
}

TEST(PlasticFlow, FunctionsThatLockUnderItAreRefusedUnlessSomebodyDecided) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.25});
  const SharedMaterial metal = J2({.moduli = {.E = 210.0, .nu = 0.3}, .yield = 0.24});
  const auto equations = [&](Dilatation dilatation, Plane plane) {
    const auto approximation = approximate(mesh, {.spacing = 0.5, .dilatation = dilatation});
    NonlinearEquilibrium<2>(approximation, {.material = metal, .plane = plane}, Program<2>::grows({clamp<2>("left")}));
  };
  EXPECT_THAT([&] { equations(Dilatation::automatic, Plane::strain); },
              ThrowsMessage<InputError>(HasSubstr("the material flows")));
  EXPECT_NO_THROW(equations(Dilatation::pointwise, Plane::strain));
  EXPECT_NO_THROW(equations(Dilatation::averaged, Plane::strain));
  EXPECT_NO_THROW(equations(Dilatation::automatic, Plane::stress));
}

/// Elastic and perfectly plastic, b / a = 2, in plane strain: 2 / sqrt(3) yield ln 2 (Hill 1950), though flow keeps the
/// volume.
TEST(PlasticFlow, AThickTubeComesToItsLimitPressureAndStaysThere) {
  const double yield = 0.24;
  const J2 metal({.moduli = {.E = 210.0, .nu = 0.3}, .yield = yield});
  const FineMesh<2> tube = triangulate(shapes::rectangle(1, 0, 2, 0.5), {.size = 0.04});
  for (const SecondaryKind secondary : {SecondaryKind::cells, SecondaryKind::linear}) {
    const auto approximation = approximate(
        tube, {.axisymmetric = true, .spacing = 0.12, .secondary = secondary, .dilatation = Dilatation::averaged});
    const NonlinearEquilibrium<2> equations(approximation, {.material = metal, .plane = Plane::axisymmetric},
                                            Program<2>::grows({symmetry_plane<2>("bottom"),
                                                               symmetry_plane<2>("top"),
                                                               {"left", {[](const Vec<2>&) { return 0.012; }}, {}}}));
    Cholesky linear;
    std::vector<double> pressures;
    follow(equations, linear, equations.rest(), {.step = 0.1}, [&](const PathStep& step) {
      pressures.push_back(equations.reactions(step.now.state).at("left").force[0] / (2.0 * std::numbers::pi * 0.5));
    });
    const double limit = 2.0 / std::sqrt(3.0) * yield * std::log(2.0);
    EXPECT_NEAR(pressures.back(), limit, 0.01 * limit);
    EXPECT_LT(std::abs(pressures.back() - pressures[pressures.size() - 2]), 2e-3 * limit) << "no rising tail";
  }
}

}  // namespace
}  // namespace efree
