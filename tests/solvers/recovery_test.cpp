// SPDX-License-Identifier: GPL-3.0-or-later
/// Recovered fields from given values at the quadrature points: what the fits and their blending lose.
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <gtest/gtest.h>

namespace efree {
namespace {

/// Largest error anywhere of the stress recovered from the exact one at the quadrature points.
template <int Dim> double recovery_error(const Approximation<Dim>& approximation, const VoigtField<Dim>& exact) {
  const auto at = [&](const Points<Dim>& points) {
    VoigtPoints<Dim> values(voigt_size<Dim>, points.cols());
    for (Index p = 0; p < points.cols(); ++p) values.col(p) = exact(points.col(p));
    return values;
  };
  const auto stress = at(approximation.quadrature.points);
  const Points<Dim> at_rest = Points<Dim>::Zero(Dim, approximation.shape.num_nodes());
  const auto fields = recover_fields(approximation, Solution<Dim>{at_rest, stress, stress});
  EXPECT_TRUE((fields.strain.array() == fields.stress.array()).all());
  return (fields.stress - at(approximation.space.points())).cwiseAbs().maxCoeff();
}

/// Every component of another linear field.
template <int Dim> Voigt<Dim> linear(const Vec<Dim>& x) {
  Voigt<Dim> value;
  for (int i = 0; i < voigt_size<Dim>; ++i) value[i] = 1.0 - 0.3 * i + (i + 1.0) * x[i % Dim] - 0.5 * x[(i + 1) % Dim];
  return value;
}

class Recovery : public ::testing::TestWithParam<SecondaryKind> {};

TEST_P(Recovery, LinearStressesAreReproduced) {
  for (const char* name : {"square", "slivers", "plate_with_hole", "l_shape", "slit"}) {
    const auto body = testing::body(name);
    for (const bool axisymmetric : {false, true})
      for (const int degree : {1, 2}) {
        const auto approximation = approximate(body.mesh, {.axisymmetric = axisymmetric,
                                                           .order = degree,
                                                           .interpolation = degree,
                                                           .spacing = body.spacing,
                                                           .secondary = GetParam()});
        EXPECT_LE(recovery_error<2>(approximation, linear<2>), 1e-11)
            << name << (axisymmetric ? ", axisymmetric" : "") << ", degree " << degree;
      }
  }
  const auto box = testing::solid("box");
  EXPECT_LE(recovery_error<3>(approximate(box, {.spacing = 0.4, .secondary = GetParam()}), linear<3>), 1e-11);
}

TEST(RecoveryAtASinglePoint, IsItsValue) {
  // Two clouds with the same corners: a node may see one point of quadrature, which lies on it.
  const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 0.5), {.size = 0.026});
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto approximation =
        approximate(mesh, {.order = 2, .spacing = 0.265, .seed = seed, .secondary = SecondaryKind::mls, .ratio = 1.0});
    const double error = recovery_error<2>(approximation, [](const Vec<2>&) { return Voigt<2>(1.0, -2.0, 0.5, 3.0); });
    EXPECT_LE(error, 1e-11) << "cloud " << seed;
  }
}

TEST_P(Recovery, AQuadraticLosesAboutHalfOfTheSpacingSquaredAtMost) {
  // x^2: the linear fits lose this much, worst at walls where they are one-sided, and the blending next to nothing.
  const auto error = [](double H) {
    const auto mesh = triangulate(shapes::rectangle(0, 0, 1, 1), {.size = H / 5.0});
    double worst = 0.0;
    for (std::uint64_t seed = 1; seed <= 3; ++seed)
      worst = std::max(
          worst, recovery_error<2>(approximate(mesh, {.spacing = H, .seed = seed, .secondary = GetParam()}),
                                   [](const Vec<2>& x) { return Voigt<2>(x.x() * x.x(), x.y() * x.y(), 0.0, 0.0); }));
    return worst;
  };
  for (const double H : {0.2, 0.1}) {
    // Linear functions on clusters have fewer places to fit to: 2.5 points per node, where indicators have 4.
    EXPECT_LE(error(H), (GetParam() == SecondaryKind::linear ? 0.6 : 0.5) * H * H) << "H = " << H;
    EXPECT_GE(error(H), 0.2 * H * H) << "H = " << H;
  }
}

INSTANTIATE_TEST_SUITE_P(Secondary, Recovery,
                         ::testing::Values(SecondaryKind::cells, SecondaryKind::linear, SecondaryKind::mls),
                         [](const auto& test) { return testing::name_of(test.param); });

}  // namespace
}  // namespace efree
