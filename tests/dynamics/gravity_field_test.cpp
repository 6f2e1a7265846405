// SPDX-License-Identifier: GPL-3.0-or-later
/// Gravity that depends on the position, by all methods: closed forms.
#include "efree/bench/elastic_block.hpp"
#include "efree/bench/mpm_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/tests/dynamics/interrupted_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <numbers>

namespace efree {
namespace {

using bench::block;
using testing::HasSubstr;
using testing::ThrowsMessage;

enum class Method { otm, cloud, mpm, mpm_total, mpm_mesh, sph, sph_total };
constexpr Method all_methods[] = {Method::otm,      Method::cloud, Method::mpm,      Method::mpm_total,
                                  Method::mpm_mesh, Method::sph,   Method::sph_total};

SharedMaterial material_of(double E) {
  return NeoHookean({.E = E, .nu = 0.0});
}

/// A bar of height 1 along x, at rest.
Dynamics<2> bar_by(Method method, double length, double E, double size, const DynamicsOptions& options = {}) {
  const MpmOptions grid{.cell = size};
  const SphOptions particles{.spacing = size, .viscosity = {0.0, 0.0}};
  const auto material = material_of(E);
  const auto on_grid = [&](MpmFrame frame) {
    const double edge = frame == MpmFrame::mesh ? 0.5 * size : size;
    return body_on_lattice<2>(block<2>(length, edge), frame, grid, 2, material, 1.0);
  };
  switch (method) {
    case Method::cloud:
      return {
          {deformable_body(approximate(block<2>(length, 0.3 * size), {.spacing = size, .support = dynamics_support}),
                           material, 1.0)},
          total_lagrangian<2>(),
          options};
    case Method::mpm:
      return {{on_grid(MpmFrame::updated)}, mpm<2>(grid), options};
    case Method::mpm_total:
      return {{on_grid(MpmFrame::total)}, total_lagrangian<2>(), options};
    case Method::mpm_mesh:
      return {{on_grid(MpmFrame::mesh)}, mpm<2>(grid), options};
    case Method::sph:
      return {{particles_on_lattice<2>(block<2>(length, size), SphFrame::updated, particles, material, 1.0)},
              sph<2>(particles),
              options};
    case Method::sph_total:
      return {{particles_on_lattice<2>(block<2>(length, size), SphFrame::total, particles, material, 1.0)},
              total_lagrangian<2>(),
              options};
    default:
      return {{deformable_body(block<2>(length, size), material, 1.0)},
              otm<2>({.reconnection_strain = 0.5, .merging = 0.0}),
              options};
  }
}

/// Towards x = 2 in proportion to the distance: a mass point there swings with the angular frequency `rate`.
GravityField<2> spring_to_two(double rate) {
  return [rate](const Vec<2>& x, double) { return Vec<2>(-rate * rate * (x[0] - 2.0), 0.0); };
}

TEST(GravityField, AStiffBodySwingsAsAHarmonicOscillatorByAllMethods) {
  // Strains are rate^2 / (8 E) of the body of length 1, whose centre swings from x = 0.5 to 3.5 in half a period.
  constexpr double rate = 0.05, E = 1.0, step = 0.02;
  for (const Method method : all_methods) {
    SCOPED_TRACE(static_cast<int>(method));
    Dynamics<2> dynamics = bar_by(method, 1.0, E, 0.1);
    dynamics.set_gravity_field(spring_to_two(rate));
    const Points<2> start = dynamics.points();
    const Vec<2> momentum = dynamics.balance().momentum;
    const double mass = dynamics.masses().sum(), half = std::numbers::pi / rate;
    ASSERT_LT(momentum.norm(), 1e-15);
    EXPECT_NEAR(mass, 1.0, 1e-12);
    ASSERT_GT(dynamics.stable_step(), step);
    double largest = 0.0, energy = 0.0;
    while (dynamics.time() < half) {
      dynamics.step(step);
      const double way = 1.5 * (1.0 - std::cos(rate * dynamics.time()));
      const Points<2> off = (dynamics.points() - start).colwise() - Vec<2>(way, 0.0);
      largest = std::max(largest, off.cwiseAbs().maxCoeff());
      const auto at = dynamics.balance();
      const double kinetic = 0.5 * std::pow(1.5 * rate * std::sin(rate * dynamics.time()), 2);
      energy = std::max(energy, std::abs(at["gravity"] - kinetic));
    }
    EXPECT_GT(dynamics.points().row(0).minCoeff(), 2.9);
    EXPECT_LT(largest, 1e-3);
    EXPECT_LT(energy, 1e-3 * 0.5 * std::pow(1.5 * rate, 2));
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-4);
  }
}

/// How far points of a body with next to no stiffness are from x = 2 + (X - 2) cos(rate t) at rate t = 1, where the
/// body is 0.54 of its length.
double error_of_dust(Method method, double step) {
  constexpr double rate = 1.0;
  Dynamics<2> dynamics = bar_by(method, 1.0, 1e-9, 0.1, {.imbalance = 1.0});
  dynamics.set_gravity_field(spring_to_two(rate));
  const Points<2> start = dynamics.points();
  while (dynamics.time() < 1.0 - 1e-9) dynamics.step(std::min(step, 1.0 - dynamics.time()));
  Points<2> exact = start;
  exact.row(0) = (2.0 + (start.row(0).array() - 2.0) * std::cos(rate * dynamics.time())).matrix();
  return (dynamics.points() - exact).cwiseAbs().maxCoeff();
}

TEST(GravityField, PointsWithoutStiffnessFollowTheField) {
  for (const Method method : all_methods) {
    SCOPED_TRACE(static_cast<int>(method));
    const double coarse = error_of_dust(method, 0.02), fine = error_of_dust(method, 0.01);
    const double rate = std::log2(coarse / fine);
    switch (method) {
      case Method::cloud:  // the series of its mass matrix ends after four terms: a sixth of the spacing
        EXPECT_LT(coarse, 0.02);
        break;
      case Method::mpm:  // affine velocities move with their points in every step, to first order
      case Method::mpm_mesh:
        EXPECT_LT(coarse, 1e-3);
        EXPECT_NEAR(rate, 0.9, 0.25);
        break;
      default:
        EXPECT_LT(coarse, 5e-5);
        EXPECT_NEAR(rate, 2.0, 0.1);
    }
  }
}

/// A bar of length 2 and Young's modulus 1, held at x = 0, in the field g = c x: its stress is c (4 - x^2) / 2.
struct Rest {
  double stress;  ///< error, root mean square over the points, over the largest stress
  double end;     ///< error of the displacement of the point nearest to its end, relative
};
Rest error_at_rest(Method method, double size) {
  constexpr double c = 1e-4;
  Dynamics<2> dynamics = bar_by(method, 2.0, 1.0, size);
  dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, 0, 0.0);
  dynamics.set_gravity_field([](const Vec<2>& x, double) { return Vec<2>(c * x[0], 0.0); });
  const Points<2> start = dynamics.points();
  dynamics.come_to_rest(1e-7, 100000);
  Index end;
  const double x = start.row(0).maxCoeff(&end), exact = 0.5 * c * (4.0 * x - x * x * x / 3.0);
  const Vector stress = dynamics.cauchy_stress().row(0).transpose();
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-6);
  const Vector along = 0.5 * c * (4.0 - start.row(0).array().square()).transpose();
  return {(stress - along).norm() / (2.0 * c * std::sqrt(static_cast<double>(start.cols()))),
          std::abs((dynamics.points() - start)(0, end) / exact - 1.0)};
}

TEST(GravityField, AHeldBarRestsWithTheStressOfALinearField) {
  for (const Method method : {Method::otm, Method::cloud}) {
    SCOPED_TRACE(static_cast<int>(method));
    const Rest coarse = error_at_rest(method, 0.2), fine = error_at_rest(method, 0.1);
    EXPECT_LT(fine.stress, 0.015);
    EXPECT_LT(fine.end, 0.01);
    const double rate = std::log2(coarse.stress / fine.stress);
    EXPECT_GT(rate, 0.7);
    EXPECT_LT(rate, 2.3);
  }
}

TEST(GravityField, ARigidBodySwingsByTheFieldAtItsCentre) {
  constexpr double rate = 0.5;
  std::vector<double> errors;
  for (const double step : {0.02, 0.01}) {
    Dynamics<2> dynamics = bar_by(Method::otm, 1.0, 1.0, 0.25);
    dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>({0.0, -20.0}, 1.0), .centre = {0.0, -20.0}, .mass = 3.0});
    dynamics.set_gravity_field(
        [](const Vec<2>& x, double) { return Vec<2>(x[1] < -10.0 ? -rate * rate * (x[0] - 2.0) : 0.0, 0.0); });
    double largest = 0.0;
    while (dynamics.time() < 2.0 * std::numbers::pi / rate) {
      dynamics.step(step);
      const double exact = 2.0 - 2.0 * std::cos(rate * dynamics.time());
      largest = std::max(largest, std::abs(dynamics.rigid_bodies()[0].centre[0] - exact));
      const double work = 0.5 * 3.0 * std::pow(2.0 * rate * std::sin(rate * dynamics.time()), 2);
      ASSERT_NEAR(dynamics.balance()["gravity"], work, 3.0 * step * step);
    }
    EXPECT_GT(dynamics.points().row(0).minCoeff(), 0.0);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3);
    errors.push_back(largest);
  }
  EXPECT_NEAR(std::log2(errors[0] / errors[1]), 2.0, 0.1);
}

TEST(GravityField, AUniformFieldIsGravityToTheLastBit) {
  for (const Method method : all_methods) {
    SCOPED_TRACE(static_cast<int>(method));
    Dynamics<2> constant = bar_by(method, 1.0, 1.0, 0.1), field = bar_by(method, 1.0, 1.0, 0.1);
    for (Dynamics<2>* each : {&constant, &field}) each->add_wall({.normal = {0.0, 1.0}, .level = -0.01});
    const Points<2> start = constant.points();
    constant.set_gravity({0.01, -0.1});
    field.set_gravity({0.3, 0.3});
    field.set_gravity_field([](const Vec<2>&, double) { return Vec<2>(1.0, 1.0); });
    field.set_gravity_field([](const Vec<2>&, double) { return Vec<2>(0.01, -0.1); });
    EXPECT_LT((constant.world().nodes.force - field.world().nodes.force).cwiseAbs().maxCoeff(), 1e-15);
    // Forces of a step are added from nothing.
    field = bar_by(method, 1.0, 1.0, 0.1);
    field.add_wall({.normal = {0.0, 1.0}, .level = -0.01});
    field.set_gravity_field([](const Vec<2>&, double) { return Vec<2>(0.01, -0.1); });
    constant.run(2.0);
    field.run(2.0);
    EXPECT_GT((constant.points() - start).norm(), 0.1);
    EXPECT_TRUE(constant.points() == field.points());
    EXPECT_TRUE(constant.cauchy_stress() == field.cauchy_stress());
    EXPECT_NEAR(constant.balance()["gravity"], field.balance()["gravity"], 1e-3 * constant.balance()["gravity"]);
  }
}

TEST(GravityField, ResultsAreBitwiseTheSameOnThreadsAndFromAState) {
  for (const Method method : all_methods) {
    SCOPED_TRACE(static_cast<int>(method));
    const auto made = [&] {
      Dynamics<2> dynamics = bar_by(method, 1.0, 1.0, 0.1);
      dynamics.set_gravity_field(
          [](const Vec<2>& x, double t) { return Vec<2>(-0.1 * (1.0 + t) * (x[0] - 2.0), 0.05 * std::sin(x[0] + t)); });
      return dynamics;
    };
    const auto ran = [&](int threads, bool breaks_off) {
      return test::run_in_two(threads, breaks_off, 0.5, 1.0, made);
    };
    const Dynamics<2> one = ran(1, false);
    EXPECT_GT(one.balance()["gravity"], 1e-3);
    EXPECT_LT(std::abs(one.energy().largest_error()), 1e-3);
    for (const Dynamics<2>& other : {ran(2, false), ran(1, true)}) {
      EXPECT_TRUE(one.points() == other.points());
      EXPECT_EQ(one.balance()["gravity"], other.balance()["gravity"]);
      EXPECT_EQ(one.balance().total(), other.balance().total());
    }
  }
}

TEST(GravityField, FieldsThatAreNotFiniteAreRefused) {
  Dynamics<2> dynamics = bar_by(Method::otm, 1.0, 1.0, 0.25);
  EXPECT_THROW(dynamics.set_gravity_field({}), InputError);
  EXPECT_THAT([&] { dynamics.set_gravity_field([](const Vec<2>& x, double) { return Vec<2>(0.0, 1.0 / x[0]); }); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("gravity at (0, "), HasSubstr("is not finite"))));
}

}  // namespace
}  // namespace efree
