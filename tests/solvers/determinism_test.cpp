// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/parallel.hpp"
#include "efree/tests/solvers/kirsch.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

struct Everything {
  Vector shape_values;
  Points<2> points;
  Vector weights;
  Solution<2> solution;
  Fields<2> fields;
};

Everything run(const FineMesh<2>& mesh, const ApproximationOptions& options, const ElasticModel& model, int threads) {
  set_num_threads(threads);
  const auto approximation = approximate(mesh, options);
  const auto pulled = [](const Vec<2>& x, const Vec<2>& n) { return traction<2>(testing::kirsch::stress(x), n); };
  auto solution = ElasticSolver<2>(approximation, model, {clamp<2>("left")}).solve({{{"right", pulled}}, {}});
  auto fields = recover_fields(approximation, solution);
  const auto N = approximation.shape.matrix();
  return {Eigen::Map<const Vector>(N.valuePtr(), N.nonZeros()), approximation.quadrature.points,
          approximation.quadrature.weights, std::move(solution), std::move(fields)};
}

/// Equal to the last bit; NaN would be unequal to itself.
template <class A> void expect_same(const A& a, const A& b) {
  ASSERT_EQ(a.rows(), b.rows());
  ASSERT_EQ(a.cols(), b.cols());
  EXPECT_TRUE((a.array() == b.array()).all());
}

void expect_same_on_two_threads(const ApproximationOptions& options, const ElasticModel& model) {
  const auto mesh = testing::kirsch::mesh(0.06);
  const auto one = run(mesh, options, model, 1), two = run(mesh, options, model, 2);
  set_num_threads(1);
  expect_same(one.shape_values, two.shape_values);
  expect_same(one.points, two.points);
  expect_same(one.weights, two.weights);
  expect_same(one.solution.coefficients, two.solution.coefficients);
  expect_same(one.solution.stress, two.solution.stress);
  expect_same(one.fields.displacement, two.fields.displacement);
  expect_same(one.fields.stress, two.fields.stress);
  EXPECT_EQ(one.solution.strain_energy, two.solution.strain_energy);
}

const ElasticModel stress{.material = LinearElastic(1.0, 0.3), .plane = Plane::stress};
const ElasticModel strain{.material = LinearElastic(1.0, 0.49), .plane = Plane::strain, .stabilisation = 0.5};

TEST(Determinism, OneAndTwoThreadsAgreeBitwiseOnCells) {
  expect_same_on_two_threads({.spacing = 0.3}, stress);
}
TEST(Determinism, OneAndTwoThreadsAgreeBitwiseOnLinearFunctions) {
  expect_same_on_two_threads({.spacing = 0.3, .secondary = SecondaryKind::linear}, stress);
  expect_same_on_two_threads(
      {.order = 2, .spacing = 0.3, .secondary = SecondaryKind::linear, .dilatation = Dilatation::averaged},
      {.material = LinearElastic(1.0, 0.49), .plane = Plane::strain});
}
TEST(Determinism, OneAndTwoThreadsAgreeBitwiseOnLumpedMls) {
  expect_same_on_two_threads({.spacing = 0.3, .secondary = SecondaryKind::mls}, stress);
}
TEST(Determinism, OneAndTwoThreadsAgreeBitwiseWithOrderTwoUnionsAndStabilisation) {
  expect_same_on_two_threads({.order = 2, .spacing = 0.3, .dilatation = Dilatation::averaged, .fine = true}, strain);
}
TEST(Determinism, OneAndTwoThreadsAgreeBitwiseWithEveryWeight) {
  for (const Weight weight : {Weight::heat_geodesic, Weight::heat_flow, Weight::fast_marching})
    expect_same_on_two_threads({.spacing = 0.6, .weight = weight}, stress);
}
TEST(Determinism, OneAndTwoThreadsAgreeBitwiseOnQuadraticElements) {
  expect_same_on_two_threads({.kind = BasisKind::p2}, stress);
}

}  // namespace
}  // namespace efree
