// SPDX-License-Identifier: GPL-3.0-or-later
/// Effective tensors of images against closed forms, bounds and series.
#include "efree/tests/solvers/labelled_image.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/materials/linear_elastic.hpp"
#include "efree/solvers/cells/effective.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

namespace efree {
namespace {

using CellCounts = std::array<Index, 3>;
using test::image_of;

/// A cube with a ball in its middle that fills so much of it.
LabelImage<3> ball_of(Index n, double fraction, Label inside, Label outside) {
  const double radius = n * std::cbrt(0.75 * fraction / std::numbers::pi);
  return image_of({n, n, n}, [=](const Vec<3>& x) -> Label {
    return (x - Vec<3>::Constant(0.5 * n)).norm() < radius ? inside : outside;
  });
}
LabelImage<3> gyroid_of(Index n) {
  const double a = 2.0 * std::numbers::pi / n;
  return image_of({n, n, n}, [=](const Vec<3>& x) -> Label {
    double sum = 0.0;
    for (int d = 0; d < 3; ++d) sum += std::sin(a * x[d]) * std::cos(a * x[(d + 1) % 3]);
    return sum < 0.0;
  });
}

struct LameModuli {
  double lambda, mu;
};
LameModuli lame(double E, double nu) {
  return {E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))};
}
Matrix isotropic_stiffness(const LameModuli& m) {
  Matrix C = Matrix::Zero(6, 6);
  C.topLeftCorner<3, 3>().setConstant(m.lambda);
  C.diagonal().head<3>().array() += 2.0 * m.mu;
  C.diagonal().tail<3>().setConstant(m.mu);
  return C;
}
std::vector<SharedMaterial> two_materials() {
  return {SharedMaterial{}, SharedMaterial(LinearElastic(10.0, 0.3)), SharedMaterial(LinearElastic(1.37, 0.17))};
}

/// Layers normal to an axis, exactly (Backus 1962, eqs 9 and 13).
Matrix laminate(const std::array<double, 2>& fraction, const std::array<LameModuli, 2>& m, int axis) {
  const auto mean = [&](const auto& f) { return fraction[0] * f(m[0]) + fraction[1] * f(m[1]); };
  const double across = 1.0 / mean([](const LameModuli&l) { return 1.0 / (l.lambda + 2.0 * l.mu); }),
               share = mean([](const LameModuli&l) { return l.lambda / (l.lambda + 2.0 * l.mu); }),
               along =
                   mean([](const LameModuli&l) { return 4.0 * l.mu * (l.lambda + l.mu) / (l.lambda + 2.0 * l.mu); }) +
                   share * share * across,
               shear = mean([](const LameModuli&l) { return l.mu; }),
               shear_across = 1.0 / mean([](const LameModuli&l) { return 1.0 / l.mu; });
  Matrix C = Matrix::Zero(6, 6);
  const int b = (axis + 1) % 3, c = (axis + 2) % 3;
  C(axis, axis) = across;
  C(b, b) = C(c, c) = along;
  C(b, c) = C(c, b) = along - 2.0 * shear;
  C(axis, b) = C(b, axis) = C(axis, c) = C(c, axis) = share * across;
  C(3 + axis, 3 + axis) = shear;
  C(3 + b, 3 + b) = C(3 + c, 3 + c) = shear_across;
  return C;
}

/// E 10 : 3 : 1 along axes of its own.
OrthotropicElastic tilted(double angle) {
  const Mat<3> axes = Eigen::AngleAxisd(angle, Vec<3>(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  return OrthotropicElastic({{10.0, 3.0, 1.0}, {0.3, 0.25, 0.35}, {0.7, 1.1, 2.0}, axes});
}
Mat<3> tensor_of(const Vector& strain) {
  Mat<3> tensor;
  tensor << strain[0], 0.5 * strain[5], 0.5 * strain[4], 0.5 * strain[5], strain[1], 0.5 * strain[3], 0.5 * strain[4],
      0.5 * strain[3], strain[2];
  return tensor;
}
/// Stress of a displacement gradient.
Mat<3> stress_of(const SharedMaterial& material, const Mat<3>& gradient) {
  Deformation deformation = Deformation::none(Points<3>(Vec<3>::Zero()), material->history_size());
  deformation.F.col(0) += gradient.reshaped();
  return respond(*material, deformation, false).P.col(0).reshaped(3, 3);
}
/// Layers normal to an axis, of any materials: gradients E + a_i n with one traction, and a_i whose mean is zero.
Matrix laminate_of(const std::array<double, 2>& fraction, const std::array<SharedMaterial, 2>& materials, int axis) {
  const Vec<3> n = Vec<3>::Unit(axis);
  std::array<Mat<3>, 2> acoustic;
  for (int i = 0; i < 2; ++i)
    for (int c = 0; c < 3; ++c) acoustic[i].col(c) = stress_of(materials[i], Vec<3>::Unit(c) * n.transpose()) * n;
  Matrix C(6, 6);
  for (int load = 0; load < 6; ++load) {
    const Mat<3> strain = tensor_of(Vector::Unit(6, load));
    Mat<3> sum = Mat<3>::Zero();
    Vec<3> rhs = Vec<3>::Zero();
    for (int i = 0; i < 2; ++i) {
      sum += fraction[i] * acoustic[i].inverse();
      rhs += fraction[i] * acoustic[i].inverse() * (stress_of(materials[i], strain) * n);
    }
    const Vec<3> traction = sum.inverse() * rhs;
    Mat<3> mean = Mat<3>::Zero();
    for (int i = 0; i < 2; ++i) {
      const Vec<3> a = acoustic[i].inverse() * (traction - stress_of(materials[i], strain) * n);
      mean += fraction[i] * stress_of(materials[i], strain + a * n.transpose());
    }
    C.col(load) << mean(0, 0), mean(1, 1), mean(2, 2), mean(1, 2), mean(0, 2), mean(0, 1);
  }
  return C;
}

double smallest_eigenvalue(const Matrix& symmetric) {
  return Eigen::SelfAdjointEigenSolver<Matrix>(symmetric).eigenvalues()[0];
}
double difference(const Matrix& a, const Matrix& b) {
  return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

}  // namespace

TEST(EffectiveStiffness, OfOneMaterialIsItsOwn) {
  const auto image = image_of({5, 3, 4}, [](const Vec<3>&) -> Label { return 1; });
  for (const FrameCondition frame : {FrameCondition::periodic, FrameCondition::kinematic, FrameCondition::uniform}) {
    const EffectiveTensor found = effective_stiffness(image, two_materials(), {.frame = frame});
    EXPECT_LT(difference(found.tensor, isotropic_stiffness(lame(10.0, 0.3))), 1e-8);
    EXPECT_LT(difference(found.mean, isotropic_stiffness(lame(10.0, 0.3))), 1e-6);
  }
}

TEST(EffectiveStiffness, OfALaminateIsExactWhateverTheNumbersOfVoxels) {
  for (const int axis : {0, 1, 2})
    for (const Index n : {15, 22, 31}) {
      CellCounts size{5, 3, 4};
      size[axis] = n;
      const Index layer = n / 3;
      const auto image = image_of(size, [&](const Vec<3>& x) -> Label { return x[axis] < layer ? 1 : 2; });
      const double f = static_cast<double>(layer) / n;
      const Matrix exact = laminate({f, 1.0 - f}, {lame(10.0, 0.3), lame(1.37, 0.17)}, axis);
      for (const bool smooth : {true, false}) {
        const EffectiveTensor found = effective_stiffness(image, two_materials(), {.smooth = smooth});
        EXPECT_LT(difference(found.tensor, exact), 1e-8) << n << " voxels along " << axis;
        EXPECT_LT(found.iteration_error, 1e-8);
      }
    }
}

TEST(EffectiveStiffness, OfOneAnisotropicMaterialIsItsOwnAlongTheAxesOfTheImage) {
  auto image = image_of({5, 3, 4}, [](const Vec<3>&) -> Label { return 1; });
  const Matrix exact = laminate_of({0.5, 0.5}, {tilted(0.7), tilted(0.7)}, 0);
  for (const FrameCondition frame : {FrameCondition::periodic, FrameCondition::kinematic, FrameCondition::uniform}) {
    const EffectiveTensor found = effective_stiffness(image, {{}, tilted(0.7)}, {.frame = frame, .tolerance = 1e-7});
    EXPECT_LT(difference(found.tensor, exact), 1e-8);
    EXPECT_LT(difference(found.mean, exact), 1e-6);
  }
  image.axes = Eigen::AngleAxisd(0.7, Vec<3>(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  EXPECT_LT(difference(effective_stiffness(image, {{}, tilted(0.7)}, {}).tensor,
                       laminate_of({0.5, 0.5}, {tilted(0.0), tilted(0.0)}, 0)),
            1e-8);
}

TEST(EffectiveStiffness, OfAnAnisotropicLaminateIsExact) {
  for (const int axis : {0, 2})
    for (const Index n : {15, 22}) {
      CellCounts size{5, 3, 4};
      size[axis] = n;
      const Index layer = n / 3;
      const auto image = image_of(size, [&](const Vec<3>& x) -> Label { return x[axis] < layer ? 1 : 2; });
      const double f = static_cast<double>(layer) / n;
      for (const SharedMaterial& other :
           {SharedMaterial(LinearElastic(1.37, 0.17)), SharedMaterial(tilted(1.3)), SharedMaterial(tilted(0.0))}) {
        const Matrix exact = laminate_of({f, 1.0 - f}, {tilted(0.7), other}, axis);
        for (const bool smooth : {true, false}) {
          const EffectiveTensor found =
              effective_stiffness(image, {{}, tilted(0.7), other}, {.smooth = smooth, .tolerance = 1e-6});
          EXPECT_LT(difference(found.tensor, exact), 1e-7) << n << " voxels along " << axis;
          EXPECT_LT(found.asymmetry, 1e-5);
        }
      }
    }
}

TEST(EffectiveStiffness, OfPoresInAnAnisotropicMaterialLiesBetweenThatOfOtherConditions) {
  const auto image = ball_of(14, 0.25, 0, 1);
  std::array<Matrix, 3> tensors;
  int at = 0;
  for (const FrameCondition frame : {FrameCondition::uniform, FrameCondition::periodic, FrameCondition::kinematic}) {
    const EffectiveTensor found = effective_stiffness(image, {{}, tilted(0.7)}, {.frame = frame, .size = 1.0});
    tensors[at++] = found.tensor;
    EXPECT_LT(found.finest().iterations, 60);
  }
  const double size = tensors[1].norm();
  EXPECT_GT(smallest_eigenvalue(tensors[1] - tensors[0]), -1e-6 * size);
  EXPECT_GT(smallest_eigenvalue(tensors[2] - tensors[1]), -1e-6 * size);
  EXPECT_GT(smallest_eigenvalue(0.75 * laminate_of({0.5, 0.5}, {tilted(0.7), tilted(0.7)}, 0) - tensors[2]), 0.0)
      << "Voigt's bound";
}

TEST(EffectiveStiffness, OfALaminateThatCutsCellsIsWithinItsStatedError) {
  for (const double interface : {9.0, 11.0, 13.0}) {
    const auto image = image_of({30, 4, 4}, [&](const Vec<3>& x) -> Label { return x[0] < interface ? 1 : 2; });
    const double f = interface / 30.0;
    const Matrix exact = laminate({f, 1.0 - f}, {lame(10.0, 0.3), lame(1.37, 0.17)}, 0);
    const EffectiveTensor found = effective_stiffness(image, two_materials(), {.size = 2.0});
    const double error = (found.tensor - exact).norm() / exact.norm();
    EXPECT_GT(error, 1e-5);
    EXPECT_LT(error, found.grid_error) << interface;
  }
}

TEST(EffectiveStiffness, TakesModuliWhereTheImageIs) {
  const auto image = image_of({7, 3, 3}, [](const Vec<3>&) -> Label { return 1; });
  const SharedMaterial varying(LinearElastic(Parameter([](const Vec<3>& x) { return 1.0 + x[0]; }), 0.0));
  const EffectiveTensor found = effective_stiffness(image, {{}, varying});
  EXPECT_NEAR(found.tensor(1, 1), 4.5, 1e-6) << "parallel to the frame's mean, and negative beyond the frame";
  const double in_series = 7.0 / std::log(8.0);
  EXPECT_NEAR(found.extrapolated(0, 0), in_series, 0.02 * in_series);
}

/// Cells of half a voxel are halved along one axis, then two: their differences do not fall by equal ratios.
TEST(EffectiveStiffness, IsNotExtrapolatedAcrossGridsOfUnequalRatios) {
  LabelImage<3> image = image_of({31, 1, 29}, [](const Vec<3>& x) -> Label { return int(x[2]) % 2 + 1; });
  image.spacing = {1.0, 2.0, 0.3};
  const EffectiveTensor found = effective_stiffness(image, two_materials());
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(found.extrapolated(i, i), found.tensor(i, i), 0.25 * found.tensor(i, i)) << i;
}

TEST(EffectiveStiffness, LiesBetweenItsBoundsAndThoseOfOtherConditions) {
  const auto image = ball_of(14, 0.25, 2, 1);
  std::array<Matrix, 3> tensors;
  for (const FrameCondition frame : {FrameCondition::uniform, FrameCondition::periodic, FrameCondition::kinematic})
    tensors[frame == FrameCondition::uniform    ? 0
            : frame == FrameCondition::periodic ? 1
                                                : 2] =
        effective_stiffness(image, two_materials(), {.frame = frame, .size = 1.0}).tensor;
  double f = 0.0;
  for (const Label label : image.labels) f += (label == 2 ? 1.0 : 0.0) / static_cast<double>(image.labels.size());
  const Matrix C1 = isotropic_stiffness(lame(10.0, 0.3)), C2 = isotropic_stiffness(lame(1.37, 0.17)),
               voigt = f * C2 + (1.0 - f) * C1, reuss = (f * C2.inverse() + (1.0 - f) * C1.inverse()).inverse();
  EXPECT_GT(smallest_eigenvalue(tensors[1] - tensors[0]), 1e-4);
  EXPECT_GT(smallest_eigenvalue(tensors[2] - tensors[1]), 1e-4);
  EXPECT_GT(smallest_eigenvalue(voigt - tensors[2]), 1e-4);
  EXPECT_GT(smallest_eigenvalue(tensors[0] - reuss), 1e-4);
}

TEST(EffectiveStiffness, OfSphericalPoresComesFromAboveAndIsJustBelowHashinAndShtrikman) {
  const EffectiveTensor found = effective_stiffness(ball_of(48, 0.2, 0, 1), two_materials());
  const auto bulk = [](const Matrix& C) { return C.topLeftCorner<3, 3>().sum() / 9.0; };
  for (std::size_t l = 1; l < found.levels.size(); ++l)
    for (int d = 0; d < 6; ++d) EXPECT_GT(found.levels[l].tensor(d, d), found.levels[l - 1].tensor(d, d));
  const LameModuli m = lame(10.0, 0.3);
  const double kappa = m.lambda + 2.0 / 3.0 * m.mu, add = 4.0 / 3.0 * m.mu,
               bound = 1.0 / (0.8 / (kappa + add) + 0.2 / add) - add;
  EXPECT_LT(bulk(found.tensor), bound);
  EXPECT_GT(bulk(found.tensor), 0.995 * bound);
  // Of 96 x 96 x 96 voxels: 8.69620, 3.17618, 2.46152, and 2 parts in 10000 lower extrapolated.
  EXPECT_NEAR(found.tensor(0, 0), 8.695, 0.005 * 8.695);
  EXPECT_NEAR(found.tensor(0, 1), 3.175, 0.005 * 3.175);
  EXPECT_NEAR(found.tensor(3, 3), 2.461, 0.005 * 2.461);
  EXPECT_LT(found.grid_error, 0.005);
  // The iterations leave next to nothing of what the grid does; to the end they lead to the same.
  EXPECT_LT(found.iteration_error, 0.01 * found.grid_error);
  const EffectiveTensor to_the_end = effective_stiffness(ball_of(48, 0.2, 0, 1), two_materials(), {.tolerance = 2e-5});
  EXPECT_LT(difference(found.tensor, to_the_end.tensor), std::max(1e-8, 2.0 * found.iteration_error));
  EXPECT_LT(to_the_end.asymmetry, 1e-6);
}

/// What is nearly incompressible gives way into its pores: by Hashin and Shtrikman (1963) K <= about 4 G (1 - f) / (3
/// f), hundreds of times less than its own.
TEST(EffectiveStiffness, OfPoresInNearlyIncompressibleMaterialIsFarFromItsBulkModulus) {
  const LabelImage<3> image = ball_of(32, 0.15, 0, 1);
  const double fraction = static_cast<double>(std::ranges::count(image.labels, Label{0})) / std::pow(32.0, 3);
  for (const double nu : {0.49, 0.499}) {
    const auto [lambda, G] = lame(1.0, nu);
    const double K = lambda + 2.0 * G / 3.0,
                 bound = K + fraction / (-1.0 / K + 3.0 * (1.0 - fraction) / (3.0 * K + 4.0 * G));
    const EffectiveTensor found =
        effective_stiffness(image, {SharedMaterial{}, SharedMaterial(LinearElastic(1.0, nu))}, {.size = 1.0});
    const double effective = found.extrapolated.topLeftCorner<3, 3>().sum() / 9.0;
    EXPECT_LT(effective, 1.015 * bound) << nu << ": the image's ball, 0.3 % at nu = 0.3 and 0.1 % of 48 voxels";
    EXPECT_GT(effective, 0.93 * bound) << nu;
    EXPECT_GT(smallest_eigenvalue(found.tensor), 0.0);
  }
}

TEST(EffectiveStiffness, OfAGyroidIsCubicAndThatOfAFinerImage) {
  const Matrix fine = effective_stiffness(gyroid_of(48), two_materials()).tensor;
  // Of 96 x 96 x 96 voxels, extrapolated.
  EXPECT_NEAR(fine(0, 0), 2.6602, 0.005 * 2.6602);
  EXPECT_NEAR(fine(0, 1), 1.0397, 0.005 * 1.0397);
  EXPECT_NEAR(fine(3, 3), 1.0408, 0.005 * 1.0408);
  for (int d = 0; d < 3; ++d) {
    EXPECT_NEAR(fine(d, d), fine(0, 0), 1e-7);
    EXPECT_NEAR(fine(d, (d + 1) % 3), fine(0, 1), 1e-7);
    EXPECT_NEAR(fine(3 + d, 3 + d), fine(3, 3), 1e-7);
  }
}

TEST(EffectiveStiffness, IsThatWithoutIslands) {
  const Index n = 16;
  const auto shell = [&](bool island) {
    return image_of({n, n, n}, [=](const Vec<3>& x) -> Label {
      const double r = (x - Vec<3>::Constant(0.5 * n)).norm() / n;
      return r > 0.35 || (island && r < 0.2);
    });
  };
  const Matrix with = effective_stiffness(shell(true), two_materials(), {.smooth = false}).tensor,
               without = effective_stiffness(shell(false), two_materials(), {.smooth = false}).tensor;
  EXPECT_LT(difference(with, without), 1e-7);
  const std::vector<double> k{0.0, 1.0};
  EXPECT_LT(difference(effective_conductivity(shell(true), k, {.smooth = false}).tensor,
                       effective_conductivity(shell(false), k, {.smooth = false}).tensor),
            1e-7);
}

TEST(EffectiveStiffness, IsZeroWhereVoidCutsTheVolume) {
  const auto balls = effective_stiffness(ball_of(12, 0.2, 1, 0), two_materials());
  EXPECT_LT(balls.tensor.cwiseAbs().maxCoeff(), 1e-6 * balls.mean.maxCoeff());
  // Plates that nothing connects: plane stress in them.
  const auto plates = image_of({10, 6, 6}, [](const Vec<3>& x) -> Label { return x[0] < 5.0; });
  const Matrix C = effective_stiffness(plates, two_materials()).tensor;
  EXPECT_LT(C.row(0).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_NEAR(C(1, 1), 0.5 * 10.0 / (1.0 - 0.09), 1e-6);
  EXPECT_NEAR(C(1, 2), 0.5 * 3.0 / (1.0 - 0.09), 1e-6);
}

TEST(EffectiveStiffness, IsTheSameOnAnyNumberOfThreads) {
  const int before = num_threads();
  const auto image = ball_of(13, 0.3, 0, 1);
  std::vector<EffectiveTensor> found;
  for (const int threads : {1, 3}) {
    set_num_threads(threads);
    found.push_back(effective_stiffness(image, two_materials(), {.size = 1.0}));
  }
  set_num_threads(before);
  EXPECT_EQ(found[0].tensor, found[1].tensor);
  EXPECT_EQ(found[0].asymmetry, found[1].asymmetry);
}

TEST(EffectiveConductivity, OfALaminateIsExact) {
  const auto image = image_of({5, 21, 3}, [](const Vec<3>& x) -> Label { return x[1] < 8.0 ? 1 : 2; });
  const double f = 8.0 / 21.0, along = 3.0 * f + 0.4 * (1.0 - f), across = 1.0 / (f / 3.0 + (1.0 - f) / 0.4);
  for (const FrameCondition frame : {FrameCondition::periodic, FrameCondition::kinematic, FrameCondition::uniform}) {
    const Matrix K = effective_conductivity(image, {0.0, 3.0, 0.4}, {.frame = frame}).tensor;
    if (frame == FrameCondition::periodic) {
      EXPECT_NEAR(K(0, 0), along, 1e-8);
      EXPECT_NEAR(K(2, 2), along, 1e-8);
      EXPECT_NEAR(K(1, 1), across, 1e-8);
    } else {
      EXPECT_GT(K(1, 1), across - 1e-8);
      EXPECT_LT(K(0, 0), along + 1e-8);
    }
  }
}

TEST(EffectiveConductivity, OfACheckerboardIsTheGeometricMean) {
  // Keller 1964. The gradient is singular where four squares meet.
  const auto image =
      image_of({32, 32, 1}, [](const Vec<3>& x) -> Label { return (x[0] < 16.0) == (x[1] < 16.0) ? 1 : 2; });
  const EffectiveTensor found = effective_conductivity(image, {0.0, 1.0, 10.0}, {.smooth = false});
  Matrix exact = Matrix(Vec<3>(std::sqrt(10.0), std::sqrt(10.0), 5.5).asDiagonal());
  const double error = (found.tensor - exact).norm() / exact.norm();
  EXPECT_LT(error, 1.1 * found.grid_error);
  EXPECT_LT(error, 0.01);
  EXPECT_LT((found.extrapolated - exact).norm() / exact.norm(), 0.0005);
}

TEST(EffectiveConductivity, OfInsulatingSpheresIsThatOfSanganiAndAcrivos) {
  // Simple cubic array (Sangani & Acrivos 1983, eq. 27 and table 1).
  const double f = 0.2;
  const auto L = [](int i) { return -(2.0 * i - 1.0) / (2.0 * i); };
  const double denominator = -1.0 / L(1) + f +
                             1.3047 * L(2) * std::pow(f, 10.0 / 3.0) * (1.0 + 0.1526 * L(3) * std::pow(f, 11.0 / 3.0)) /
                                 (1.0 - 0.2305 * L(2) * std::pow(f, 7.0 / 3.0)) +
                             0.4054 * L(3) * std::pow(f, 14.0 / 3.0) + 0.0723 * L(4) * std::pow(f, 6.0) +
                             0.0105 * L(5) * std::pow(f, 22.0 / 3.0);
  const double exact = 1.0 - 3.0 * f / denominator;
  const EffectiveTensor found = effective_conductivity(ball_of(48, f, 0, 1), {0.0, 1.0});
  for (int d = 0; d < 3; ++d) EXPECT_NEAR(found.tensor(d, d), exact, 0.001 * exact);
}

TEST(EffectiveConductivity, OfOneLayerIsThatOfMany) {
  const auto layers = [](Index n) {
    return image_of({12, 9, n},
                    [](const Vec<3>& x) -> Label { return (x - Vec<3>(5.0, 4.0, x[2])).norm() < 3.2 ? 1 : 2; });
  };
  const EffectiveOptions to_the_end{.size = 1.0, .tolerance = 5e-5};
  const Matrix one = effective_conductivity(layers(1), {0.0, 1.0, 7.0}, to_the_end).tensor,
               many = effective_conductivity(layers(5), {0.0, 1.0, 7.0}, to_the_end).tensor;
  EXPECT_LT(difference(one, many), 1e-7);
  const Matrix C = effective_stiffness(layers(1), two_materials(), to_the_end).tensor,
               D = effective_stiffness(layers(5), two_materials(), to_the_end).tensor;
  EXPECT_LT(difference(C, D), 1e-7);
}

TEST(EffectiveTensors, RefuseWhatTheyCannotFind) {
  using ::testing::HasSubstr, ::testing::ThrowsMessage;
  const auto body = image_of({4, 4, 4}, [](const Vec<3>& x) -> Label { return x[0] < 2.0 ? 1 : 3; });
  const auto nothing = image_of({4, 4, 4}, [](const Vec<3>&) -> Label { return 0; });
  const auto hollow = image_of({4, 4, 4}, [](const Vec<3>& x) -> Label { return x[0] < 2.0; });
  EXPECT_THAT([&] { effective_stiffness(body, two_materials()); }, ThrowsMessage<InputError>(HasSubstr("label 3")));
  EXPECT_THAT([&] { effective_conductivity(body, {0.0, 1.0}); }, ThrowsMessage<InputError>(HasSubstr("label 3")));
  EXPECT_THAT([&] { effective_stiffness(nothing, two_materials()); },
              ThrowsMessage<InputError>(HasSubstr("all of the image is void")));
  EXPECT_THAT([&] { effective_conductivity(nothing, {0.0}); },
              ThrowsMessage<InputError>(HasSubstr("nothing in the image conducts")));
  EXPECT_THAT([&] { effective_conductivity(hollow, {0.0, -1.0}); }, ThrowsMessage<InputError>(HasSubstr("is -1")));
  EXPECT_THAT([&] { effective_stiffness(hollow, two_materials(), {.frame = FrameCondition::uniform}); },
              ThrowsMessage<InputError>(HasSubstr("void reaches the frame")));
  EXPECT_THAT([&] { effective_stiffness(hollow, two_materials(), {.size = -1.0}); },
              ThrowsMessage<InputError>(HasSubstr("size of cells")));
}

}  // namespace efree
