// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/case_file.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <random>

namespace efree {
namespace {

const std::string examples = EFREE_EXAMPLES;

Case<2> kirsch() {
  return std::get<Case<2>>(read_case(examples + "/plate_with_hole/case.toml"));
}

/// Points of the quarter plate outside the hole, the boundary left out by `margin`.
std::vector<Vec<2>> plate_points(double margin) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> coordinate(margin, 4.0 - margin);
  std::vector<Vec<2>> points;
  while (points.size() < 200) {
    const double up = coordinate(random), along = coordinate(random);  // arguments are evaluated in any order
    const Vec<2> x(along, up);
    if (x.norm() > 1.0 + margin) points.push_back(x);
  }
  return points;
}

TEST(KirschSolution, StressBelongsToTheDisplacement) {
  const Case<2> plate = kirsch();
  const VoigtMatrix<2> C =
      Materials<2>({plate.common.model.material}, *plate.common.model.plane).stiffness(0, Vec<2>::Zero()).C;
  constexpr double h = 1e-4;
  for (const Vec<2>& x : plate_points(0.01)) {
    const auto difference = [&](int j) {
      const Vec<2> step = h * Vec<2>::Unit(j);
      return Vec<2>((plate.exact.displacement(x + step) - plate.exact.displacement(x - step)) / (2 * h));
    };
    const Vec<2> dx = difference(0), dy = difference(1);
    const Voigt<2> strain(dx[0], dy[1], 0.0, dx[1] + dy[0]);
    EXPECT_LT((C * strain - plate.exact.stress(x)).cwiseAbs().maxCoeff(), 1e-6) << x.transpose();
  }
}

TEST(KirschSolution, IsInEquilibrium) {
  const Case<2> plate = kirsch();
  constexpr double h = 1e-4;
  for (const Vec<2>& x : plate_points(0.01)) {
    const Voigt<2> dx =
        (plate.exact.stress(x + h * Vec<2>::UnitX()) - plate.exact.stress(x - h * Vec<2>::UnitX())) / (2 * h);
    const Voigt<2> dy =
        (plate.exact.stress(x + h * Vec<2>::UnitY()) - plate.exact.stress(x - h * Vec<2>::UnitY())) / (2 * h);
    EXPECT_NEAR(dx[0] + dy[3], 0.0, 1e-5) << x.transpose();
    EXPECT_NEAR(dx[3] + dy[1], 0.0, 1e-5) << x.transpose();
  }
}

TEST(KirschSolution, LeavesTheHoleFreeAndTriplesTheTensionAboveIt) {
  const Case<2> plate = kirsch();
  for (int i = 0; i <= 90; ++i) {
    const double t = i * std::acos(-1.0) / 180.0;
    const Vec<2> n(std::cos(t), std::sin(t));
    EXPECT_LT(traction<2>(plate.exact.stress(n), n).norm(), 1e-12);
  }
  EXPECT_NEAR(plate.exact.stress(Vec<2>(0, 1))[0], 3.0, 1e-12);
  EXPECT_NEAR(plate.exact.displacement(Vec<2>(0, 2))[0], 0.0, 1e-12);
  EXPECT_NEAR(plate.exact.displacement(Vec<2>(2, 0))[1], 0.0, 1e-12);
}

TEST(KirschSolution, LoadsAreItsStresses) {
  const Case<2> plate = kirsch();
  ASSERT_EQ(plate.loads.tractions.size(), 2u);
  const Vec<2> right(4, 1.7), top(2.1, 4);
  EXPECT_EQ(plate.loads.tractions[0].traction(right, Vec<2>::UnitX()),
            traction<2>(plate.exact.stress(right), Vec<2>::UnitX()));
  EXPECT_EQ(plate.loads.tractions[1].traction(top, Vec<2>::UnitY()),
            traction<2>(plate.exact.stress(top), Vec<2>::UnitY()));
}

TEST(Examples, OfLoadsAreWithinAPercentOfTheirClosedForms) {
  for (const char* name : {"rotating_disc", "bedding", "remote_force"}) {
    const auto result = analyse(std::get<Case<2>>(read_case(examples + "/loads/" + name + ".toml")));
    EXPECT_LT(*result.errors->l2_displacement, 0.001) << name;
    EXPECT_LT(*result.errors->energy_norm_recovered, 0.015) << name;
    EXPECT_LT(result.balance.error, 1e-12) << name;
  }
}

TEST(Examples, ThickCylinderIsWithinAPercentWithEightNodesThroughTheWall) {
  const auto result = analyse(std::get<Case<2>>(read_case(examples + "/thick_cylinder/axisymmetric.toml")));
  EXPECT_LE(*result.errors->l2_displacement, 0.01);
  const double u = 1.3 / 3.0 * (0.4 + 4.0), hoop = 5.0 / 3.0;
  EXPECT_NEAR(result.probes.at(0).second.displacement.x() / u, 1.0, 0.01);
  EXPECT_NEAR(result.probes.at(0).second.stress[2] / hoop, 1.0, 0.01);
}

TEST(Examples, RubberTubeIsInflatedAsItsClosedForm) {
  const auto result = analyse(std::get<Case<2>>(read_case(examples + "/rubber/tube.toml")));
  EXPECT_TRUE(result.stopped.empty()) << result.stopped;
  for (const auto& step : result.history) {
    const double a = 1.0 + step.probes.at(0).x(), b = std::sqrt(1.0 + 0.25 * (a * a - 1.0));
    const double p = std::log(a / b) + 0.5 * (1.0 / (b * b) - 1.0 / (a * a));
    EXPECT_NEAR(p / (0.574 * step.time), 1.0, 0.01) << a;
    EXPECT_EQ(step.negative_pivots, 0);
  }
  EXPECT_NEAR(result.history.back().probes.at(0).x(), 1.0, 0.03);
}

TEST(Examples, CookAveragesTheDilatationOnlyWhereItLocks) {
  const auto stress = std::get<Case<2>>(read_case(examples + "/cook/plane_stress.toml")),
             strain = std::get<Case<2>>(read_case(examples + "/cook/plane_strain.toml"));
  EXPECT_EQ(with_defaults<2>(stress, prepare(stress)).common.approximation.dilatation, Dilatation::pointwise);
  EXPECT_EQ(with_defaults<2>(strain, prepare(strain)).common.approximation.dilatation, Dilatation::averaged);
  EXPECT_EQ(strain.loads.tractions.at(0).traction({48, 50}, {1, 0}), Vec<2>(0, 6.25));
}
TEST(Examples, CookInPlaneStrainIsCorrectedToATenthOfAPercent) {
  const auto result = analyse(std::get<Case<2>>(read_case(examples + "/cook/plane_strain.toml")));
  ASSERT_TRUE(result.estimates);
  EXPECT_LT(result.estimates->total(), 0.05);
  EXPECT_NEAR(result.probes.at(0).second.displacement.y() / 7.695, 1.0, 1e-3);
}

}  // namespace
}  // namespace efree
