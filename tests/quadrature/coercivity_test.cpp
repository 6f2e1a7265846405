// SPDX-License-Identifier: GPL-3.0-or-later
/// Eigenvalues of the projected stiffness against the fully integrated one, rigid motions removed.
#include "efree/bench/inf_sup.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

namespace efree {
namespace {

const Materials<2> materials({LinearElastic(1.0, 0.3)}, Plane::stress);

/// Smallest and largest eigenvalue lambda of (projected stiffness) u = lambda (full stiffness) u.
std::pair<double, double> extreme_eigenvalues(const Approximation<2>& approximation) {
  const Matrix basis = bench::without_rigid_motions<2>(approximation.nodes);
  const Matrix projected = bench::reduced_stiffness(approximation.quadrature, materials, basis);
  const Matrix full = bench::reduced_stiffness(approximation.fine, materials, basis);
  const Vector lambda =
      Eigen::GeneralizedSelfAdjointEigenSolver<Matrix>(projected, full, Eigen::EigenvaluesOnly).eigenvalues();
  return {lambda.minCoeff(), lambda.maxCoeff()};
}

class Coercivity : public ::testing::TestWithParam<std::tuple<SecondaryKind, int>> {};

TEST_P(Coercivity, ProjectedStiffnessIsAtLeastAFifthOfTheFullOneAndNeverMore) {
  const auto [secondary, seed] = GetParam();
  const auto mesh = triangulate(shapes::quarter_plate_with_hole(1.0, 4.0, 0.06), {.size = 0.06});
  const auto approximation = approximate(
      mesh, {.spacing = 0.4, .seed = static_cast<std::uint64_t>(seed), .secondary = secondary, .fine = true});
  const auto [smallest, largest] = extreme_eigenvalues(approximation);
  EXPECT_GE(smallest, 0.2) << approximation.nodes.cols() << " nodes";
  EXPECT_LE(largest, 1.0 + 1e-10);
  ::testing::Test::RecordProperty("smallest", std::to_string(smallest));
}

TEST(CoercivityOfPores, ProjectedStiffnessIsAtLeastAFifthOfTheFullOneWhereNodesAreAsDenseAsFineVertices) {
  const auto body = testing::body("pores");
  for (const std::uint64_t seed : {1, 2, 3}) {
    const auto approximation =
        approximate(body.mesh, {.spacing = body.spacing, .grading = {.features = true}, .seed = seed, .fine = true});
    const auto [smallest, largest] = extreme_eigenvalues(approximation);
    EXPECT_GE(smallest, 0.2) << "cloud " << seed << ", " << body.mesh.num_vertices() << " fine vertices and "
                             << approximation.nodes.cols() << " nodes";
    EXPECT_LE(largest, 1.0 + 1e-10);
  }
}

TEST(InfSup, ClustersOfLinearFunctionsHoldThePressureHoweverFineTheCloud) {
  for (const double H : {0.2, 0.1, 0.07}) {
    const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 3.0});
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const auto approximation = approximate(
          mesh, {.spacing = H, .seed = seed, .secondary = SecondaryKind::linear, .dilatation = Dilatation::averaged});
      EXPECT_GE(bench::inf_sup(approximation, materials), 0.5) << "H = " << H << ", cloud " << seed;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Defaults, Coercivity,
                         ::testing::Combine(::testing::Values(SecondaryKind::cells, SecondaryKind::linear,
                                                              SecondaryKind::mls),
                                            ::testing::Values(1, 2, 3)),
                         [](const auto& test) {
                           return testing::name_of(std::get<0>(test.param)) + std::string("_") +
                                  std::to_string(std::get<1>(test.param));
                         });

}  // namespace
}  // namespace efree
