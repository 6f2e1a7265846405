// SPDX-License-Identifier: GPL-3.0-or-later
/// Plates with random holes smaller than the spacing: stiffness against converged P2 finite elements.
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

struct Stretched {
  double stiffness;
  Index nodes;
};

/// Effective stiffness of a plate under unit tension, held by symmetry on the left and below.
Stretched stretch(const FineMesh<2>& mesh, const ApproximationOptions& options, double stabilisation = 0.0) {
  const auto approximation = approximate(mesh, options);
  const ScalarField<2> zero = [](const Vec<2>&) { return 0.0; };
  const ElasticSolver<2> solver(
      approximation, {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .stabilisation = stabilisation},
      {{"left", {zero, nullptr}, nullptr}, {"bottom", {nullptr, zero}, nullptr}});
  const auto solution = solver.solve({{{"right", [](const Vec<2>&, const Vec<2>&) -> Vec<2> { return {1, 0}; }}}, {}});
  return {0.5 / solution.strain_energy, approximation.shape.num_nodes()};
}

class RandomHoles : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  static PlanarDomain plate(double size) {
    return shapes::plate_with_random_holes(2.0, 16, 0.03, 0.3, 0.03, GetParam(), size);
  }
};

TEST_P(RandomHoles, GradedCloudsComeWithinThreePercentOfTheTruthWithTwentyTimesFewerUnknowns) {
  const double truth = stretch(triangulate(plate(0.01), {.size = 0.05}), {.kind = BasisKind::p2}).stiffness;
  const auto mesh = triangulate(plate(0.025), {.size = 0.025});
  const Stretched graded = stretch(mesh, {.spacing = 0.2, .grading = {.features = true}});
  EXPECT_NEAR(graded.stiffness / truth, 1.0, 0.03);
  EXPECT_GT(mesh.num_vertices(), 20 * graded.nodes);
}

TEST_P(RandomHoles, QuadraticCellsMakeUpForACoarseFineMesh) {
  const double truth = stretch(triangulate(plate(0.01), {.size = 0.05}), {.kind = BasisKind::p2}).stiffness;
  const auto mesh = triangulate(plate(0.05), {.size = 0.1});
  const ApproximationOptions quadratic{.spacing = 0.2, .grading = {.features = true}};
  ApproximationOptions linear = quadratic;
  linear.interpolation = 1;
  const double error = std::abs(stretch(mesh, quadratic).stiffness / truth - 1.0);
  EXPECT_LT(error, 0.08);
  EXPECT_LT(error, 0.7 * std::abs(stretch(mesh, linear).stiffness / truth - 1.0));
}

TEST(Pores, StabilisationStiffensThoughMostClustersAreTakenApart) {
  const auto body = testing::body("pores");
  ApproximationOptions options{.spacing = body.spacing, .grading = {.features = true}, .ratio = 8.0, .fine = true};
  const auto approximation = approximate(body.mesh, options);
  EXPECT_GT(approximation.quadrature.size(), body.mesh.num_cells());
  EXPECT_LT(approximation.quadrature.size(), approximation.fine.size());
  const double soft = stretch(body.mesh, options).stiffness, half = stretch(body.mesh, options, 0.5).stiffness;
  options.secondary = SecondaryKind::full;
  const double full = stretch(body.mesh, options).stiffness;
  EXPECT_GT(half, 1.001 * soft);
  EXPECT_LT(half, full);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomHoles, ::testing::Values(1, 2, 3));

}  // namespace
}  // namespace efree
