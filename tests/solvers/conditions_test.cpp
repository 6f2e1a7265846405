// SPDX-License-Identifier: GPL-3.0-or-later
/// Displacement conditions and load cases, end to end.
#include "efree/core/error.hpp"
#include "efree/tests/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };

class BothWays : public ::testing::TestWithParam<std::tuple<SecondaryKind, Essential>> {
 protected:
  ApproximationOptions options(double spacing, const std::vector<std::string>& held) const {
    const auto [secondary, essential] = GetParam();
    return {.spacing = spacing,
            .secondary = secondary,
            .vanish_on = essential == Essential::strong ? held : std::vector<std::string>{}};
  }
  ElasticModel model() const {
    return {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = std::get<1>(GetParam())};
  }
};

TEST_P(BothWays, TensionAlongAnInclinedBarThatSlidesOnTwoSidesIsExact) {
  // A bar turned by 30 degrees slides on its foot and on one flank; uniaxial tension along it is linear.
  const Eigen::Rotation2Dd turn(std::numbers::pi / 6.0);
  PlanarDomain bar = shapes::rectangle(0, 0, 2, 1);
  for (auto& line : bar.boundary)
    for (auto& x : line.points) x = turn * x;
  const auto mesh = triangulate(bar, {.size = 0.06});
  const auto approximation = approximate(mesh, options(0.3, {"left", "bottom"}));
  const ElasticSolver<2> solver(approximation, model(), {{"left", {}, zero}, {"bottom", {}, zero}});
  const auto solution = solver.solve({{{"right", [](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return n; }}}, {}});
  const auto fields = recover_fields(approximation, solution);
  double error = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    const Vec<2> local = turn.inverse() * mesh.vertex(v);
    error = std::max(error, (fields.displacement.col(v) - turn * Vec<2>(local.x(), -0.3 * local.y())).norm());
  }
  EXPECT_LE(error, 1e-11);
  const Vec<2> a = turn * Vec<2>::UnitX();
  const Voigt<2> stress(a.x() * a.x(), a.y() * a.y(), 0.0, a.x() * a.y());
  EXPECT_LE((solution.stress.colwise() - stress).cwiseAbs().maxCoeff(), 1e-11);
  EXPECT_NEAR(solution.strain_energy, 0.5 * 2.0, 1e-11);
}

TEST_P(BothWays, SymmetryPlanesThatMeetInACornerLeaveBiaxialTensionExact) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.05});
  const auto approximation = approximate(mesh, options(0.25, {"left", "bottom"}));
  const ElasticSolver<2> solver(approximation, model(),
                                {{"left", {zero, nullptr}, {}}, {"bottom", {nullptr, zero}, {}}});
  const auto pull = [](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return {n.x(), 2.0 * n.y()}; };
  const auto solution = solver.solve({{{"right", pull}, {"top", pull}}, {}});
  const Points<2> u = recover_fields(approximation, solution).displacement.leftCols(mesh.num_vertices());
  const Points<2> exact = Vec<2>(1.0 - 0.6, 2.0 - 0.3).asDiagonal() * mesh.vertices();
  EXPECT_LE((u - exact).cwiseAbs().maxCoeff(), 1e-11);
}

TEST_P(BothWays, LoadCasesShareAFactorisationAndSuperpose) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 2, 1), {.size = 0.06});
  const auto approximation = approximate(mesh, options(0.3, {"left"}));
  const ElasticSolver<2> solver(approximation, model(), {clamp<2>("left")});
  const Loads<2> tension{{{"right", [](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return n; }}}, {}};
  const Loads<2> weight{{}, [](const Vec<2>&) -> Vec<2> { return {0.0, -1.0}; }};
  const Loads<2> both{tension.tractions, weight.body_force};
  const auto together = solver.solve(both).coefficients;
  const Points<2> sum = solver.solve(tension).coefficients + solver.solve(weight).coefficients;
  EXPECT_LE((together - sum).cwiseAbs().maxCoeff(), 1e-11 * sum.cwiseAbs().maxCoeff());
  const ElasticSolver<2> alone(approximation, model(), {clamp<2>("left")});
  EXPECT_TRUE((alone.solve(weight).coefficients.array() == solver.solve(weight).coefficients.array()).all())
      << "bitwise";
}

TEST_P(BothWays, ReactionsAreThereWithoutLoads) {
  // Two opposite sides pulled apart by prescribed displacements of the normal component alone.
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.05});
  const auto approximation = approximate(mesh, options(0.25, {"left", "right", "bottom"}));
  const ScalarField<2> stretch = [](const Vec<2>&) { return 0.01; };
  const auto solution =
      ElasticSolver<2>(approximation, model(), {{"left", {}, zero}, {"right", {}, stretch}, {"bottom", {}, zero}})
          .solve({});
  EXPECT_LE((solution.stress.colwise() - Voigt<2>(0.01, 0.0, 0.0, 0.0)).cwiseAbs().maxCoeff(), 1e-13);
}

INSTANTIATE_TEST_SUITE_P(Conditions, BothWays,
                         ::testing::Combine(::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls),
                                            ::testing::Values(Essential::nitsche, Essential::strong)),
                         [](const auto& test) {
                           return std::string(testing::name_of(std::get<0>(test.param))) +
                                  (std::get<1>(test.param) == Essential::nitsche ? "_nitsche" : "_strong");
                         });

TEST(ElasticSolverInput, BadInputIsRefusedWithAReason) {
  const auto body = testing::body("square");
  const auto approximation = approximate(body.mesh, {.spacing = body.spacing});
  const ElasticModel good{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
  const auto refuses = [&](const ElasticModel& model, const std::vector<DisplacementCondition<2>>& conditions,
                           const char* text) {
    EXPECT_THAT([&] { ElasticSolver<2>(approximation, model, conditions); },
                ThrowsMessage<InputError>(HasSubstr(text)));
  };
  refuses(good, {}, "underconstrained");
  refuses(good, {{"left", {zero, nullptr}, {}}}, "translation along y");
  refuses(good, {clamp<2>("lfet")}, "lfet");
  refuses({.plane = Plane::stress}, {clamp<2>("left")}, "no material");
  refuses({.material = LinearElastic(1.0, 0.3)}, {clamp<2>("left")}, "expected Plane::stress");
  refuses({.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .stabilisation = 1.5}, {clamp<2>("left")},
          "stabilisation = 1.5");
  refuses({.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .stabilisation = 0.5}, {clamp<2>("left")},
          "stabilisation");  // full integration was not built
  refuses({.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = Essential::strong},
          {clamp<2>("left")}, "does not vanish");
}

TEST(ElasticSolverInput, TooFewQuadraturePointsAreSaidToBeTheReason) {
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = 0.03});
  const auto approximation = approximate(mesh, {.spacing = 0.15, .ratio = 0.3});
  EXPECT_THAT(
      [&] {
        ElasticSolver<2>(approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                         {clamp<2>("left")});
      },
      ThrowsMessage<NumericalError>(HasSubstr("too few quadrature points per node")));
}

TEST(ElasticSolverInput, NumbersTooLargeToComputeWithAreRefused) {
  const auto body = testing::body("square");
  const auto approximation = approximate(body.mesh, {.spacing = body.spacing});
  const auto refuses = [&](double E, double shear, double traction, const char* text) {
    const auto solve = [&] {
      const DisplacementCondition<2> sheared{"left", {[&](const Vec<2>& x) { return shear * x.y(); }, zero}, {}};
      const auto pull = [&](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return traction * n; };
      ElasticSolver<2>(approximation, {.material = LinearElastic(E, 0.3), .plane = Plane::stress}, {sheared})
          .solve({{{"right", pull}}, {}});
    };
    EXPECT_THAT(solve, ThrowsMessage<NumericalError>(HasSubstr(text)));
  };
  refuses(1.0, 1e200, 1.0, "loads or displacements are too large");
  refuses(1.0, 0.0, 1e305, "loads or displacements are too large");
  for (const double E : {1e307, 1e70, 1e-70})
    EXPECT_THAT(
        [&] {
          ElasticSolver<2>(approximation, {.material = LinearElastic(E, 0.3), .plane = Plane::stress},
                           {clamp<2>("left")});
        },
        ThrowsMessage<InputError>(HasSubstr("take other units (moduli from 1e-60 to 1e+60)")));
}

TEST(Probe, OutsideTheBodyIsRefusedWithTheNearestPoint) {
  const auto body = testing::body("square");
  const auto approximation = approximate(body.mesh, {.spacing = body.spacing});
  const auto solution =
      ElasticSolver<2>(approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}, {clamp<2>("left")})
          .solve({});
  const auto fields = recover_fields(approximation, solution);
  EXPECT_THAT(
      [&] {
        probe<2>(approximation.space, fields, {1.5, 1.0});
      },
      ThrowsMessage<InputError>(HasSubstr("(1, 1)")));
  EXPECT_NO_THROW(probe<2>(approximation.space, fields, {1.0, 1.0}));
}

TEST(Bodies, TwoHeldBodiesDoNotFeelEachOther) {
  PlanarDomain two = shapes::rectangle(0, 0, 1, 1);
  two.boundary.push_back({"foot", {{1.05, 0}, {2.05, 0}}});
  two.boundary.push_back({"other", {{2.05, 0}, {2.05, 1}, {1.05, 1}, {1.05, 0}}});
  const auto mesh = triangulate(two, {.size = 0.05});
  const auto approximation = approximate(mesh, {.spacing = 0.25});
  const auto solution = ElasticSolver<2>(approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress},
                                         {clamp<2>("left"), clamp<2>("foot")})
                            .solve({{{"right", [](const Vec<2>&, const Vec<2>& n) -> Vec<2> { return n; }}}, {}});
  const Points<2> u = recover_fields(approximation, solution).displacement.leftCols(mesh.num_vertices());
  double other = 0.0;
  for (Index v = 0; v < mesh.num_vertices(); ++v)
    if (mesh.vertex(v).x() > 1.02) other = std::max(other, u.col(v).norm());
  EXPECT_EQ(other, 0.0);
  EXPECT_GT(u.cwiseAbs().maxCoeff(), 0.5);
}

}  // namespace
}  // namespace efree
