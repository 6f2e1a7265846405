// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/operators.hpp"
#include "efree/tests/bodies.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

class Operators : public ::testing::TestWithParam<ApproximationOptions> {
 protected:
  testing::Body body_ = testing::body("plate_with_hole");
  Discretization<2> quadrature_ = approximate(body_.mesh, GetParam()).quadrature;
  Points<2> U_ = Points<2>::Random(2, quadrature_.shape.num_nodes());
};

TEST_P(Operators, InternalForceIsTheAdjointOfStrain) {
  const VoigtPoints<2> stress = VoigtPoints<2>::Random(3, quadrature_.size());
  const double work = (strain(quadrature_, U_).cwiseProduct(stress).colwise().sum() * quadrature_.weights).value();
  EXPECT_NEAR(U_.cwiseProduct(internal_force(quadrature_, stress)).sum(), work,
              1e-12 * U_.norm() * internal_force(quadrature_, stress).norm());
}

TEST_P(Operators, StiffnessMatrixActsLikeStrainThenStressThenForce) {
  const auto C = stiffness<2>(plane_lame({1.0, 0.3}, Plane::stress));
  const SymmetricMatrix K = stiffness_matrix(quadrature_, C);
  const Points<2> force = internal_force(quadrature_, C * strain(quadrature_, U_));
  const Vector product = K.selfadjointView<Eigen::Lower>() * U_.reshaped();
  EXPECT_LT((product - force.reshaped()).cwiseAbs().maxCoeff(), 1e-12 * product.cwiseAbs().maxCoeff());
  for (Index c = 0; c < K.cols(); ++c)
    for (SymmetricMatrix::InnerIterator entry(K, c); entry; ++entry)
      ASSERT_GE(entry.row(), c) << "the lower triangle only";
}

TEST_P(Operators, RigidMotionsHaveNoStrain) {
  const auto approximation = approximate(body_.mesh, GetParam());
  Points<2> rotation(2, approximation.nodes.cols());
  rotation << -approximation.nodes.row(1), approximation.nodes.row(0);
  rotation.colwise() += Vec<2>(0.7, -0.4);
  EXPECT_LT(strain(approximation.quadrature, rotation).cwiseAbs().maxCoeff(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Discretizations, Operators,
                         ::testing::Values(ApproximationOptions{.spacing = 0.2},
                                           ApproximationOptions{.spacing = 0.2, .secondary = SecondaryKind::mls},
                                           ApproximationOptions{.order = 2, .spacing = 0.2},
                                           ApproximationOptions{.kind = BasisKind::p2}));

TEST(StrainMatrix, TransposeTakesStressToTraction) {
  const Vec<2> n(0.6, 0.8);
  const Voigt<2> stress(2.0, -1.0, 0.5);
  EXPECT_LT((strain_matrix<2>(n).transpose() * stress - testing::traction_of<2>(stress, n)).norm(), 1e-15);
}

TEST(Material, VolumetricAndDeviatoricPartsMakeTheWhole) {
  const Lame lame = plane_lame({2.0, 0.4}, Plane::strain);
  const VoigtMatrix<2> whole = stiffness<2>(lame), vol = stiffness<2>(volumetric<2>(lame)),
                       dev = stiffness<2>(deviatoric<2>(lame));
  EXPECT_LT((vol + dev - whole).norm(), 1e-14 * whole.norm());
  EXPECT_LT((dev * Voigt<2>(1.0, 1.0, 0.0)).norm(), 1e-14 * whole.norm()) << "dilatation has no deviatoric stress";
  EXPECT_LT((vol * Voigt<2>(1.0, -1.0, 3.0)).norm(), 1e-14 * whole.norm()) << "shear has no pressure";
}

TEST(Material, PlaneStressLeavesNoStressAcrossThePlate) {
  const double E = 3.0, nu = 0.25;
  const Voigt<2> tension = stiffness<2>(plane_lame({E, nu}, Plane::stress)) * Voigt<2>(1.0 / E, -nu / E, 0.0);
  EXPECT_LT((tension - Voigt<2>(1.0, 0.0, 0.0)).norm(), 1e-15);
  const Voigt<2> confined =
      stiffness<2>(plane_lame({E, nu}, Plane::strain)) * Voigt<2>((1.0 - nu * nu) / E, -nu * (1.0 + nu) / E, 0.0);
  EXPECT_LT((confined - Voigt<2>(1.0, 0.0, 0.0)).norm(), 1e-15);
}

}  // namespace
}  // namespace efree
