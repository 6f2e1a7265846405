// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs that start from the state of an earlier one.
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <string>

namespace efree {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

enum class Method { otm, cloud, mpm, mpm_mesh, sph };
constexpr Method all_methods[] = {Method::otm, Method::cloud, Method::mpm, Method::mpm_mesh, Method::sph};

SharedMaterial rubber(double E = 1e3) {
  return NeoHookean({.E = E, .nu = 0.3});
}

SharedMaterial metal(double yield) {
  return J2({.moduli = {.E = 1e3, .nu = 0.3}, .yield = yield, .strain = Strain::finite});
}

/// A block that flies, turns and vibrates.
Dynamics<2> block(Method method, double size = 0.12, const SharedMaterial& material = rubber()) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = size});
  const auto with_velocity = [](DeformableBody<2> body) {
    const Points<2>& at = body.nodes.cols() > 0 ? body.nodes : body.points;
    body.velocity = Points<2>::Zero(2, at.cols());
    body.velocity.row(0) = (1.0 - 3.0 * at.row(0).array() - 2.0 * at.row(1).array()).matrix();
    body.velocity.row(1) = (0.5 + 2.0 * at.row(0).array()).matrix();
    return body;
  };
  if (method == Method::mpm || method == Method::mpm_mesh) {
    const MpmOptions grid{.cell = 0.125};
    const MpmFrame frame = method == Method::mpm ? MpmFrame::updated : MpmFrame::mesh;
    return {{with_velocity(body_on_lattice<2>(mesh, frame, grid, 2, material, 1.0))}, mpm<2>(grid)};
  }
  if (method == Method::sph) {
    const SphOptions particles{.spacing = 0.05};
    return {{with_velocity(particles_on_lattice<2>(mesh, SphFrame::updated, particles, material, 1.0))},
            sph<2>(particles)};
  }
  if (method == Method::cloud)
    return {{with_velocity(
                deformable_body(approximate(mesh, {.spacing = size, .support = dynamics_support}), material, 1.0))},
            total_lagrangian<2>()};
  return {{with_velocity(deformable_body(mesh, material, 1.0))}, otm<2>()};
}

TEST(EarlierState, ARunFromItGoesOnBitForBitWithTimeAndEnergiesFromZero) {
  for (const Method method : all_methods) {
    Dynamics<2> whole = block(method);
    whole.run(0.1);
    Dynamics<2> from = block(method);
    from.begin_from(whole.state());
    EXPECT_EQ(from.time(), 0.0);
    EXPECT_EQ(from.steps(), 0);
    EXPECT_EQ(from.points(), whole.points());
    EXPECT_EQ(from.point_velocities(), whole.point_velocities());
    EXPECT_EQ(from.cauchy_stress(), whole.cauchy_stress());
    EXPECT_EQ(from.balance()["stored"], whole.balance()["stored"]);
    for (int k = 0; k < 300; ++k) EXPECT_EQ(from.step(), whole.step()) << static_cast<int>(method) << " " << k;
    EXPECT_EQ(from.points(), whole.points()) << static_cast<int>(method);
    EXPECT_EQ(from.point_velocities(), whole.point_velocities()) << static_cast<int>(method);
    EXPECT_EQ(from.steps(), 300);
    EXPECT_LT(std::abs(from.energy().largest_error()), 0.02);
    // And from a state of its own.
    Dynamics<2> resumed = block(method);
    resumed.restore(from.state());
    EXPECT_EQ(resumed.steps(), 300);
    from.step();
    resumed.step();
    EXPECT_EQ(from.points(), resumed.points());
  }
}

TEST(EarlierState, WithoutVelocitiesBodiesStartAtRest) {
  for (const Method method : all_methods) {
    Dynamics<2> before = block(method), from = block(method);
    before.run(0.1);
    from.begin_from(before.state(), false);
    EXPECT_EQ(from.points(), before.points());
    EXPECT_TRUE(from.point_velocities().isZero(0.0));
    EXPECT_TRUE(from.velocities().isZero(0.0));
    const auto balance = from.balance();
    EXPECT_EQ(balance["kinetic"], 0.0);
    EXPECT_GT(balance["stored"], 0.0);
    from.run(0.05);
    EXPECT_LT(std::abs(from.energy().largest_error()), 0.03) << static_cast<int>(method);
    EXPECT_LT(from.balance().momentum.norm(), 1e-9 * before.balance().momentum.norm()) << static_cast<int>(method);
  }
}

TEST(EarlierState, ABlockPressedByAToolSpringsBackWithoutIt) {
  const auto make = [] {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.1});
    return Dynamics<2>({deformable_body(mesh, rubber(), 1.0)}, otm<2>());
  };
  const auto height = [](const Dynamics<2>& dynamics) {
    return dynamics.nodes().row(1).maxCoeff() - dynamics.nodes().row(1).minCoeff();
  };
  Dynamics<2> pressed = make();
  pressed.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  pressed.add_rigid_body(
      {.shape = rigid_shapes::half_space<2>({0.0, -1.0}, -0.5), .velocity = [](double) { return Vec<2>(0.0, -0.2); }});
  pressed.run(0.5);
  EXPECT_NEAR(height(pressed), 0.4, 0.005);
  Dynamics<2> free = make();
  free.begin_from(pressed.state(), false);
  EXPECT_NEAR(height(free), height(pressed), 0.0);
  free.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  const double stored = free.balance()["stored"];
  free.come_to_rest(1e-4, 1000000);
  EXPECT_NEAR(height(free), 0.5, 1e-3);
  EXPECT_LT(free.balance()["stored"], 1e-3 * stored);
}

TEST(EarlierState, ParticlesThatPressOnAWallGoOnAtIt) {
  const auto make = [] {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.12});
    const SphOptions particles{.spacing = 0.05};
    return Dynamics<2>({particles_on_lattice<2>(mesh, SphFrame::updated, particles, rubber(), 1.0)}, sph<2>(particles));
  };
  const auto add_loads = [](Dynamics<2>& dynamics) {
    dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
    dynamics.set_gravity({0.0, -20.0});
  };
  Dynamics<2> whole = make(), from = make();
  add_loads(whole);
  whole.run(0.03);
  from.begin_from(whole.state());
  add_loads(from);
  for (int k = 0; k < 20; ++k) EXPECT_EQ(from.step(), whole.step());
  EXPECT_LT((from.velocities() - whole.velocities()).norm(), 1e-3 * whole.velocities().norm());
  EXPECT_LT(std::abs(from.energy().largest_error()), 0.005);
}

TEST(EarlierState, PlasticStrainsRemain) {
  const auto make = [] {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.1});
    return Dynamics<2>({deformable_body(mesh, metal(10.0), 1.0)}, otm<2>());
  };
  Dynamics<2> pressed = make();
  for (const int side : {0, 1})
    pressed.prescribe([side](const Vec<2>& x) { return std::abs(x[1] - 0.5 * side) < 1e-9; }, 1, -0.2 * side);
  pressed.run(0.5);
  Dynamics<2> free = make();
  free.begin_from(pressed.state(), false);
  EXPECT_EQ(free.history(0), pressed.history(0));
  free.come_to_rest(1e-3, 1000000);
  const double left = free.nodes().row(1).maxCoeff() - free.nodes().row(1).minCoeff();
  EXPECT_GT(left, 0.4);
  EXPECT_LT(left, 0.415) << "of 0.5, by elastic strains of some 0.01";
}

TEST(EarlierState, MassesAreThoseOfTheMassScalingOfTheNewRun) {
  const auto make = [](const MassScaling& scaling) {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.1});
    return Dynamics<2>({deformable_body(mesh, rubber(), 1.0)}, otm<2>(), {.mass_scaling = scaling});
  };
  Dynamics<2> scaled = make({.factor = 100.0, .step = 0.05}), plain = make({});
  scaled.run(0.1);
  const double step = plain.stable_step();
  const Vector masses = plain.masses();
  plain.begin_from(scaled.state());
  EXPECT_LT((plain.masses() - masses).norm(), 1e-12 * masses.norm());
  EXPECT_NEAR(plain.stable_step(), step, 0.02 * step);
  Dynamics<2> again = make({.factor = 4.0});
  again.begin_from(plain.state());
  EXPECT_LT((again.masses() - 4.0 * masses).norm(), 1e-12 * masses.norm());
  EXPECT_NEAR(again.stable_step(), 2.0 * step, 0.05 * step);
}

TEST(EarlierState, OfOtherBodiesMethodsAndMaterialsIsRefused) {
  const auto refuses = [](const Dynamics<2>& from, Dynamics<2> to) {
    return [state = from.state(), to = std::make_shared<Dynamics<2>>(std::move(to))] {
      to->begin_from(state, true, {"strip"});
    };
  };
  const Dynamics<2> otm = block(Method::otm);
  EXPECT_THAT(refuses(otm, block(Method::cloud)),
              ThrowsMessage<InputError>(AllOf(HasSubstr("method \"otm\""), HasSubstr("\"total_lagrangian\""))));
  EXPECT_THAT(
      refuses(otm, block(Method::otm, 0.1)),
      ThrowsMessage<InputError>(AllOf(
          HasSubstr("body \"strip\" had"), HasSubstr(std::to_string(otm.num_nodes()) + " nodes"),
          HasSubstr(std::to_string(otm.num_points()) + " material points"), HasSubstr("same geometry and mesh"))));
  EXPECT_THAT(refuses(otm, block(Method::otm, 0.12, rubber(1001.0))),
              ThrowsMessage<InputError>(HasSubstr("\"strip\" was of another material")));
  EXPECT_THAT(refuses(otm, block(Method::otm, 0.12, metal(10.0))),
              ThrowsMessage<InputError>(HasSubstr("another material")));
  EXPECT_THAT(refuses(block(Method::otm, 0.12, metal(10.0)), block(Method::otm, 0.12, metal(11.0))),
              ThrowsMessage<InputError>(HasSubstr("another material")));
  const auto points = [](const MpmOptions& options) {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.5});
    return Dynamics<2>({points_on_lattice(mesh, options, 2, rubber(1000.0), 1.0),
                        points_on_lattice(triangulate(shapes::rectangle(1.0, 0.0, 2.0, 1.0), {.size = 0.5}), options, 2,
                                          rubber(1000.0), 1.0)},
                       mpm<2>(options));
  };
  for (const MpmOptions& other : {MpmOptions{.cell = 0.25, .degree = 3},
                                  {.cell = 0.25, .transfer = Transfer::polypic},
                                  {.cell = 0.25, .ties = {{0, 1}}}})
    EXPECT_THAT(refuses(points({.cell = 0.25}), points(other)),
                ThrowsMessage<InputError>(HasSubstr("expected the same cell, degree, transfer")));
  Dynamics<2> walled = block(Method::otm);
  walled.add_wall({.normal = {0.0, 1.0}, .level = -1.0});
  EXPECT_THAT(refuses(otm, std::move(walled)), ThrowsMessage<InputError>(HasSubstr("without walls")));
  EXPECT_THROW(block(Method::otm).begin_from(otm.state().substr(0, 1000)), InputError);
}

}  // namespace
}  // namespace efree
