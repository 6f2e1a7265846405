// SPDX-License-Identifier: GPL-3.0-or-later
/// Velocities that are prescribed by place and time.
#include "efree/bench/mpm_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

namespace efree {
namespace {

using bench::block, bench::soft;

/// A quarter turn about the origin in this time, from rest to rest.
constexpr double duration = 4.0;
double angle(double t) {
  return 0.25 * std::numbers::pi * (1.0 - std::cos(std::numbers::pi * t / duration));
}
double spin(double t) {
  return 0.25 * std::numbers::pi * std::numbers::pi / duration * std::sin(std::numbers::pi * t / duration);
}
VelocityLaw<2> turning(int axis) {
  return [axis](const Vec<2>& X, double t) {
    const Vec<2> x = Eigen::Rotation2Dd(angle(t)) * X;
    return spin(t) * (axis == 0 ? -x[1] : x[0]);
  };
}

/// How far positions are from their quarter turn, at most.
double error_of_turn(Dynamics<2>& dynamics, const std::function<Points<2>()>& positions, double step) {
  const Points<2> start = positions();
  while (dynamics.time() < duration - 1e-9)
    dynamics.step(std::min(step, dynamics.step_towards(duration - dynamics.time())));
  const Points<2> turned = Eigen::Rotation2Dd(0.5 * std::numbers::pi).toRotationMatrix() * start;
  return (positions() - turned).colwise().norm().maxCoeff();
}

TEST(PrescribedVelocities, NodesOfABlockTurnWithItToSecondOrderInTheStep) {
  std::vector<double> errors;
  for (const double step : {0.04, 0.02}) {
    Dynamics<2> dynamics({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
    ASSERT_LT(0.04, dynamics.stable_step());
    std::vector<Index> all(dynamics.num_nodes());
    std::iota(all.begin(), all.end(), 0);
    for (const int axis : {0, 1}) dynamics.prescribe(all, axis, turning(axis));
    errors.push_back(error_of_turn(
        dynamics, [&] { return dynamics.nodes(); }, step));
  }
  EXPECT_LT(errors[0], 1e-3);
  EXPECT_NEAR(std::log2(errors[0] / errors[1]), 2.0, 0.3);
}

TEST(PrescribedVelocities, LawsAreAskedForTheMiddlesOfStepsThatChange) {
  Dynamics<2> dynamics({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  double latest = 0.0;
  std::vector<Index> all(dynamics.num_nodes());
  std::iota(all.begin(), all.end(), 0);
  // Linear in time: the middles of steps are exact, whatever steps there are, and no time after the end is asked for.
  dynamics.prescribe(all, 0, [&](const Vec<2>&, double t) {
    latest = std::max(latest, t);
    return 0.1 * t;
  });
  const double start = dynamics.nodes()(0, 0);
  for (int k = 0; k < 20; ++k) dynamics.step(k % 2 == 0 ? 0.04 : 0.01);
  EXPECT_NEAR(dynamics.nodes()(0, 0) - start, 0.05 * dynamics.time() * dynamics.time(), 1e-14);
  EXPECT_LT(latest, dynamics.time());
}

TEST(PrescribedVelocities, PointsTurnThroughTheGrid) {
  const MpmOptions options{.cell = 0.125};
  Dynamics<2> dynamics({bench::soft_block<2>(options)}, mpm<2>(options));
  std::vector<Index> all(dynamics.num_points());
  std::iota(all.begin(), all.end(), 0);
  for (const int axis : {0, 1}) dynamics.prescribe_points(all, axis, turning(axis));
  EXPECT_LT(error_of_turn(
                dynamics, [&] { return dynamics.points(); }, 1.0),
            5e-3);
  EXPECT_LT(std::abs(dynamics.energy().error()), 1e-2);
}

TEST(PrescribedVelocities, LawsGoOnFromACheckpointToBitwiseTheSame) {
  const MpmOptions options{.cell = 0.25};
  const auto held = [&] {
    Dynamics<2> dynamics({bench::soft_block<2>(options)}, mpm<2>(options));
    std::vector<Index> left;
    for (Index p = 0; p < dynamics.num_points(); ++p)
      if (dynamics.points()(0, p) < 0.25) left.push_back(p);
    for (const int axis : {0, 1}) dynamics.prescribe_points(left, axis, turning(axis));
    return dynamics;
  };
  Dynamics<2> whole = held(), second = held();
  whole.run(1.0);
  second.restore(whole.state());
  whole.run(2.0);
  second.run(2.0);
  EXPECT_EQ(whole.points(), second.points());
  EXPECT_EQ(whole.energy().error(), second.energy().error());

  Dynamics<2> nodes({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  Dynamics<2> others({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  for (Dynamics<2>* each : {&nodes, &others}) each->prescribe(std::vector<Index>{0, 1}, 0, turning(0));
  nodes.run(1.0);
  others.restore(nodes.state());
  nodes.run(2.0);
  others.run(2.0);
  EXPECT_EQ(nodes.nodes(), others.nodes());
}

TEST(PrescribedVelocities, WrongInputIsRefused) {
  Dynamics<2> dynamics({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  EXPECT_THROW(dynamics.prescribe(std::vector<Index>{0}, 0, VelocityLaw<2>()), InputError);
  EXPECT_THROW(dynamics.prescribe(std::vector<Index>{9999}, 0, turning(0)), InputError);
  EXPECT_THROW(dynamics.prescribe(std::vector<Index>{0}, 2, turning(0)), InputError);
  EXPECT_THROW(dynamics.prescribe_points({0}, 0, turning(0)), InputError);
  // A state with laws for a run without.
  Dynamics<2> held({deformable_body(block<2>(1.0, 0.5), soft(), 1.0)}, otm<2>());
  held.prescribe(std::vector<Index>{0}, 0, turning(0));
  EXPECT_THROW(dynamics.restore(held.state()), InputError);
  held.prescribe(std::vector<Index>{1}, 0, [](const Vec<2>&, double t) { return t < 0.1 ? 0.0 : std::nan(""); });
  EXPECT_THAT([&] { held.run(1.0); }, testing::ThrowsMessage<InputError>(testing::HasSubstr("is not finite at time")));
}

}  // namespace
}  // namespace efree
