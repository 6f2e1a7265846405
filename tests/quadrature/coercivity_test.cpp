// SPDX-License-Identifier: GPL-3.0-or-later
/// Eigenvalues of the projected stiffness against the fully integrated one, rigid motions removed.
#include "efree/assembly/operators.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace efree {
namespace {

Matrix dense_stiffness(const Discretization<2>& discretization) {
  const auto C = Materials<2>({LinearElastic(1.0, 0.3)}, Plane::stress).tangents(discretization);
  return Matrix(SymmetricMatrix(stiffness_matrix(discretization, C).selfadjointView<Eigen::Lower>()));
}

/// Orthonormal complement of the rigid motions.
Matrix deformations(const Points<2>& nodes) {
  Matrix rigid = Matrix::Zero(2 * nodes.cols(), 3);
  for (Index a = 0; a < nodes.cols(); ++a) {
    rigid.block<2, 2>(2 * a, 0).setIdentity();
    rigid.block<2, 1>(2 * a, 2) << -nodes(1, a), nodes(0, a);
  }
  const Matrix Q = Eigen::HouseholderQR<Matrix>(rigid).householderQ();
  return Q.rightCols(Q.cols() - 3);
}

/// Smallest and largest eigenvalue lambda of (projected stiffness) u = lambda (full stiffness) u.
std::pair<double, double> extreme_eigenvalues(const Approximation<2>& approximation) {
  const Matrix basis = deformations(approximation.nodes);
  const Matrix projected = basis.transpose() * dense_stiffness(approximation.quadrature) * basis;
  const Matrix full = basis.transpose() * dense_stiffness(approximation.fine) * basis;
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

/// Smallest inf-sup value of pressures on patches and displacements: of int p div u over the norms of p in L2
/// and of u in the energy of the projected gradients.
double inf_sup(const Approximation<2>& approximation) {
  const Matrix basis = deformations(approximation.nodes);
  const Matrix energy = basis.transpose() * dense_stiffness(approximation.quadrature) * basis;
  const Discretization<2>& pressures = approximation.dilatation;
  Matrix divergence = Matrix::Zero(pressures.size(), 2 * approximation.nodes.cols());
  for (Index j = 0; j < pressures.size(); ++j) {
    const auto row = pressures.shape.row(j);
    for (std::size_t k = 0; k < row.nodes.size(); ++k)
      divergence.block<1, 2>(j, 2 * row.nodes[k]) = std::sqrt(pressures.weights[j]) * row.dN[k].transpose();
  }
  const Matrix reduced = divergence * basis;
  const Matrix schur = reduced * energy.llt().solve(reduced.transpose());
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix>(schur, Eigen::EigenvaluesOnly).eigenvalues().minCoeff());
}

TEST(InfSup, ClustersOfLinearFunctionsHoldThePressureHoweverFineTheCloud) {
  for (const double H : {0.2, 0.1, 0.07}) {
    const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 3.0});
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const auto approximation = approximate(
          mesh, {.spacing = H, .seed = seed, .secondary = SecondaryKind::linear, .dilatation = Dilatation::averaged});
      EXPECT_GE(inf_sup(approximation), 0.5) << "H = " << H << ", cloud " << seed;
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
