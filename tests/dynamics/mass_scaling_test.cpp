// SPDX-License-Identifier: GPL-3.0-or-later
/// Mass scaling: longer steps, the real weight, balances of momentum and energy, and the stated error.
#include "efree/bench/scaling_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/quadrature/approximation.hpp"
#include "efree/tests/dynamics/interrupted_run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <numbers>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

SharedMaterial rubber() {
  return NeoHookean({.E = 1e3, .nu = 0.3});
}

enum class Method { otm, cloud, mpm, sph };
constexpr Method all_methods[] = {Method::otm, Method::cloud, Method::mpm, Method::sph};

/// A block of density 1, 1 wide and 0.5 high.
Dynamics<2> block(Method method, const MassScaling& scaling, const Vec<2>& velocity = Vec<2>::Zero()) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.12});
  const DynamicsOptions options{.mass_scaling = scaling};
  const auto moving = [&](DeformableBody<2> body) {
    body.velocity = velocity.replicate(1, body.nodes.cols() > 0 ? body.nodes.cols() : body.points.cols());
    return body;
  };
  if (method == Method::mpm) {
    const MpmOptions grid{.cell = 0.125};
    return {{moving(body_on_lattice<2>(mesh, MpmFrame::updated, grid, 2, rubber(), 1.0))}, mpm<2>(grid), options};
  }
  if (method == Method::sph) {
    const SphOptions particles{.spacing = 0.05};
    return {{moving(particles_on_lattice<2>(mesh, SphFrame::updated, particles, rubber(), 1.0))},
            sph<2>(particles),
            options};
  }
  if (method == Method::cloud)
    return {{moving(deformable_body(approximate(mesh, {.spacing = 0.1, .support = dynamics_support}), rubber(), 1.0))},
            total_lagrangian<2>(),
            options};
  return {{moving(deformable_body(mesh, rubber(), 1.0))}, otm<2>(), options};
}

/// A plate whose cells are small around a small hole, by nodes at vertices or of finite elements.
Dynamics<2> graded_plate(bool keeps_functions, const MassScaling& scaling) {
  const auto mesh = triangulate(shapes::quarter_plate_with_hole(0.05, 1.0, 0.02), {.size = 0.15});
  auto body = keeps_functions ? deformable_body(approximate(mesh, {.kind = BasisKind::p1}), rubber(), 1.0)
                              : deformable_body(mesh, rubber(), 1.0);
  return {{std::move(body)},
          keeps_functions ? total_lagrangian<2>() : otm<2>(),
          {.mass_scaling = scaling, .contact = {.self = false}}};
}

TEST(MassScaling, AFactorMakesStepsLongerByItsRoot) {
  for (const Method method : all_methods) {
    const double own = block(method, {}).stable_step(), scaled = block(method, {.factor = 100.0}).stable_step();
    EXPECT_NEAR(scaled, 10.0 * own, 1e-6 * scaled) << static_cast<int>(method);
  }
}

TEST(MassScaling, ABodyThatFallsFreelyFallsByTheRealShareOfItsMass) {
  constexpr double factor = 25.0, g = 2.0;
  for (const Method method : all_methods) {
    Dynamics<2> dynamics = block(method, {.factor = factor});
    const double before = dynamics.points().row(1).mean();
    dynamics.set_gravity({0.0, -g});
    dynamics.run(0.5);
    const double t = dynamics.time();
    EXPECT_NEAR(before - dynamics.points().row(1).mean(), 0.5 * g / factor * t * t, 1e-9) << static_cast<int>(method);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-9) << static_cast<int>(method);
    EXPECT_GT(dynamics.added_inertia().error(), 1e3) << "it is no quasi-static process";
  }
}

TEST(MassScaling, MassIsAddedWhereTheStepIsBelowTheWantedAndNowhereElse) {
  for (const bool keeps_functions : {false, true}) {
    const Dynamics<2> plain = graded_plate(keeps_functions, {});
    const double wanted = 3.0 * plain.stable_step();
    const Dynamics<2> scaled = graded_plate(keeps_functions, {.step = wanted});
    EXPECT_GE(scaled.stable_step(), 0.99 * wanted);
    EXPECT_LT(scaled.stable_step(), 1.5 * wanted);
    EXPECT_EQ(scaled.world().unscaled_step, plain.stable_step());
    const BodyMass mass = scaled.body_masses().front();
    EXPECT_NEAR(mass.real, plain.masses().sum(), 1e-12 * mass.real);
    EXPECT_NEAR(mass.real + mass.added, scaled.masses().sum(), 1e-12 * mass.real);
    EXPECT_GT(mass.added, 0.0);
    EXPECT_LT(mass.added, 0.1 * mass.real);
    EXPECT_LT(mass.points, scaled.num_points() / 2);
    for (const auto& chunk : scaled.world().chunks)
      for (Index p = 0; p < chunk.size(); ++p)
        EXPECT_TRUE(chunk.matter.x.col(p).norm() < 0.8 || chunk.matter.added_mass[p] == 0.0);
    for (Index a = 0; a < scaled.num_nodes(); ++a)
      EXPECT_NEAR(scaled.world().real_mass(a), plain.masses()[a], 1e-12 * mass.real);
  }
}

TEST(MassScaling, AStepThatIsStableAlreadyAddsNothing) {
  const Dynamics<2> plain = graded_plate(false, {}), same = graded_plate(false, {.step = 0.5 * plain.stable_step()});
  EXPECT_EQ(same.stable_step(), plain.stable_step());
  EXPECT_EQ(same.masses(), plain.masses());
  EXPECT_EQ(same.body_masses().front().added, 0.0);
}

TEST(MassScaling, ABodyAtRestUnderItsWeightIsDeformedAsWithoutIt) {
  const auto sag = [](const MassScaling& scaling) {
    Dynamics<2> dynamics = graded_plate(false, scaling);
    const Points<2> start = dynamics.nodes();
    dynamics.prescribe([](const Vec<2>& x) { return x[0] > 1.0 - 1e-9; }, 0, 0.0);
    dynamics.prescribe([](const Vec<2>& x) { return x[0] > 1.0 - 1e-9; }, 1, 0.0);
    dynamics.set_gravity({0.0, -1.0});
    dynamics.come_to_rest(1e-7, 1000000);
    return (start - dynamics.nodes()).row(1).maxCoeff();
  };
  const double own = sag({}), step = graded_plate(false, {}).stable_step();
  EXPECT_GT(own, 1e-3);
  EXPECT_NEAR(sag({.factor = 10.0, .step = 10.0 * step}), own, 1e-4 * own);
}

TEST(MassScaling, ReconnectionKeepsTheRealMassAndTheMomentum) {
  const auto mesh = triangulate(shapes::quarter_plate_with_hole(0.05, 1.0, 0.02), {.size = 0.15});
  auto body = deformable_body(mesh, rubber(), 1.0);
  body.velocity = Points<2>::Zero(2, body.nodes.cols());
  body.velocity.row(0) = 12.0 * body.nodes.row(1);
  const OtmOptions often{.reconnection_strain = 0.01};
  DynamicsOptions options{.contact = {.self = false}};
  options.mass_scaling.step = 3.0 * Dynamics<2>({body}, otm<2>(often), options).stable_step();
  Dynamics<2> dynamics({body}, otm<2>(often), options);
  const Vec<2> momentum = dynamics.balance().momentum;
  const double real = dynamics.world().real_masses().sum();
  dynamics.run(0.1);
  EXPECT_GT(dynamics.count("reconnections"), dynamics.num_points());
  EXPECT_NEAR(dynamics.world().real_masses().sum(), real, 1e-11 * real);
  EXPECT_GT(dynamics.world().real_masses().minCoeff(), -1e-12 * real);
  EXPECT_LT((dynamics.balance().momentum - momentum).norm(), 1e-10 * momentum.norm());
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TEST(MassScaling, ContactConservesMomentumAndEnergyIsAccounted) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.12});
  auto left = deformable_body(mesh, rubber(), 1.0), right = left;
  right.nodes.row(0).array() += 1.01;
  right.points.row(0).array() += 1.01;
  left.velocity = Points<2>::Zero(2, left.nodes.cols());
  left.velocity.row(0).setConstant(2.0);
  Dynamics<2> dynamics({left, right}, otm<2>(), {.mass_scaling = {.factor = 4.0, .step = 0.01}});
  const Vec<2> momentum = dynamics.balance().momentum;
  EXPECT_NEAR(momentum[0], 2.0 * (dynamics.body_masses()[0].real + dynamics.body_masses()[0].added), 1e-12);
  dynamics.run(0.3);
  EXPECT_FALSE(dynamics.contacts().empty());
  EXPECT_LT((dynamics.balance().momentum - momentum).norm(), 1e-11 * momentum.norm());
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TEST(MassScaling, IsTheSameBitForBitOnTwoThreadsAndFromAState) {
  const auto make = [] {
    Dynamics<2> dynamics = graded_plate(false, {.factor = 2.0, .step = 0.005});
    dynamics.set_gravity({1.0, -5.0});
    dynamics.add_wall({.normal = {0.0, 1.0}, .level = -0.01});
    return dynamics;
  };
  const std::string once = test::run_in_two(1, false, 0.2, 0.5, make).state();
  const auto without_times = [&](int threads, bool breaks_off) {
    return test::run_in_two(threads, breaks_off, 0.2, 0.5, make);
  };
  const Dynamics<2> one = without_times(1, false), two = without_times(2, true);
  EXPECT_EQ(one.nodes(), two.nodes());
  EXPECT_EQ(one.world().nodes.added_mass, two.world().nodes.added_mass);
  EXPECT_EQ(one.added_inertia().error(), two.added_inertia().error());
  EXPECT_EQ(once.size(), one.state().size());
}

TEST(MassScaling, TheStatedErrorIsThatOfABarMetAtConstantSpeed) {
  // A wave of force v sqrt(K M) for the time sqrt(M / K), again and again, in a bar of length L that bears K d at the
  // end.
  constexpr double M = 2.0, K = 3.0, v = 0.01, d = 0.2, L = 5.0;
  AddedInertia inertia;
  for (int k = 1; k <= 5000; ++k) {
    const double share = k / 5000.0;
    inertia.add({.kinetic = 0.5 * M * v * v,
                 .internal = 0.5 * K * std::pow(d * share, 2),
                 .inertia = L * M * v / std::sqrt(M / K),
                 .stress = K * d * share * L});
  }
  EXPECT_NEAR(inertia.error(), v * std::sqrt(K * M) / (K * d), 1e-3 * inertia.error());
  const double at_end = 0.5 * M * v * v / (0.5 * K * d * d);
  EXPECT_NEAR(inertia.largest_ratio(), 10.0 * at_end, 0.01 * inertia.largest_ratio());
  EXPECT_GT(inertia.median_ratio(), at_end);
  EXPECT_LT(inertia.median_ratio(), 10.0 * at_end);
  AddedInertia flying;
  flying.add({.inertia = 1.0});
  EXPECT_EQ(flying.error(), std::numeric_limits<double>::infinity());
  EXPECT_EQ(AddedInertia().error(), 0.0);
}

TEST(MassScaling, AVibrationWhoseWorkIsKnownHasTheErrorOfItsInertia) {
  // A point of mass m on a spring of stiffness K that is moved as d cos(q t): the force errs by m q^2 d of K d.
  constexpr double m = 2.0, K = 3.0, d = 0.2, q = 0.4;
  for (const bool is_plastic : {false, true}) {
    AddedInertia inertia;
    for (int k = 0; k <= 1000; ++k) {
      const double u = d * std::cos(2.0 * std::numbers::pi * k / 1000.0), a = q * q * u;
      // Elastic: F u / 2 is stored; perfectly plastic: F u is dissipated.
      inertia.add({.internal = is_plastic ? K * d * std::abs(u) : 0.5 * K * u * u,
                   .stored = is_plastic ? 0.0 : 0.5 * K * u * u,
                   .force = m * a * a,
                   .displacement = m * u * u});
    }
    EXPECT_NEAR(inertia.error(), m * q * q / K, 1e-12);
  }
}

/// The stated error is between half of the error of the driving force and three times as much; returns the former.
double expect_stated_error(const bench::ScalingScene& scene, double factor) {
  const bench::ScalingResult scaled = run_scaling(scene, {.factor = factor});
  const double error = scaling_error(scaled, run_scaling(scene, {})), stated = scaled.inertia.error();
  EXPECT_TRUE(scaled.inertia.is_known()) << scene.name;
  EXPECT_GT(stated, 0.5 * error) << scene.name;
  EXPECT_LT(stated, 3.0 * error) << scene.name;
  return stated;
}

TEST(MassScaling, ABeamThatIsBentStatesTheErrorOfItsForce) {
  const auto beam = [](bool is_smooth) { return bench::drive_strip(1.0, 0.2, 1, 0.1, false, {is_smooth, 3.0}); };
  EXPECT_GT(expect_stated_error(beam(false), 100.0), 0.2) << "it rings";
  const double slow = expect_stated_error(beam(true), 10.0);
  EXPECT_LT(slow, 0.02);
  EXPECT_NEAR(expect_stated_error(beam(true), 40.0), 39.0 / 9.0 * slow, 0.3 * 39.0 / 9.0 * slow)
      << "inertia grows with the added mass";
}

TEST(MassScaling, AnImpactThatDampingStopsAtOnceIsStated) {
  for (const double damping : {3.0, 30.0})
    EXPECT_GT(expect_stated_error(bench::press_block({.loading = {false, 1.16}, .damping = damping}), 100.0), 0.05);
}

TEST(MassScaling, DampingForcesOfTheAddedMassAreStated) {
  EXPECT_GT(expect_stated_error(bench::press_block({.loading = {false, 4.0}, .damping = 30.0}), 1000.0), 0.1);
}

TEST(MassScaling, ABodyThatFliesEvenlyHasNoErrorAndOneThatHitsAWallHas) {
  for (const Method method : all_methods) {
    Dynamics<2> dynamics = block(method, {.factor = 4.0}, {0.0, -0.3});
    dynamics.add_wall({.normal = {0.0, 1.0}, .level = -0.1});
    dynamics.run(0.3);
    ASSERT_TRUE(dynamics.added_inertia().is_known());
    EXPECT_LT(dynamics.added_inertia().samples().back().inertia, 1e-9) << static_cast<int>(method);
    dynamics.run(1.0);
    EXPECT_GT(dynamics.added_inertia().error(), 0.2) << static_cast<int>(method);
  }
}

TEST(MassScaling, WrongNumbersAreRefused) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double factor : {0.5, 0.0, -1.0, nan})
    EXPECT_THAT([&] { block(Method::otm, {.factor = factor}); },
                ThrowsMessage<InputError>(HasSubstr("expected a factor of 1 or more")));
  for (const double step : {-1.0, nan})
    EXPECT_THAT([&] { block(Method::otm, {.step = step}); },
                ThrowsMessage<InputError>(HasSubstr("expected a step of 0 or more")));
  EXPECT_THAT([] { block(Method::mpm, {.step = 1.0}); }, ThrowsMessage<InputError>(HasSubstr("a factor alone")));
  EXPECT_THAT([] { block(Method::sph, {.step = 1.0}); }, ThrowsMessage<InputError>(HasSubstr("a factor alone")));
}

}  // namespace
}  // namespace efree
