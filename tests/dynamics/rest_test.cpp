// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/quadrature/approximation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr double E = 1e3, nu = 0.3;
SharedMaterial rubber() {
  return NeoHookean({.E = E, .nu = nu});
}

/// A cantilever, 2 long and 0.2 high, of density 1 under gravity, by nodes at vertices or on a cloud.
Dynamics<2> cantilever(bool on_cloud) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 0.2), {.size = on_cloud ? 0.025 : 0.05});
  auto body = on_cloud ? deformable_body(approximate(mesh, {.spacing = 0.05}), rubber(), 1.0)
                       : deformable_body(mesh, rubber(), 1.0);
  Dynamics<2> dynamics({std::move(body)}, on_cloud ? total_lagrangian<2>() : otm<2>());
  for (const int axis : {0, 1}) dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, axis, 0.0);
  dynamics.set_gravity({0.0, -0.01});
  return dynamics;
}

TEST(Rest, ABeamThatStartsAtRestUnderGravityStaysThere) {
  for (const bool on_cloud : {false, true}) {
    Dynamics<2> dynamics = cantilever(on_cloud);
    const Points<2> start = dynamics.nodes();
    dynamics.come_to_rest(1e-7, 1000000);
    EXPECT_EQ(dynamics.time(), 0.0);
    EXPECT_EQ(dynamics.steps(), 0);
    const Points<2> rest = dynamics.nodes();
    const double sag = (start - rest).row(1).maxCoeff();
    // Beam in plane strain with shear (Timoshenko 1921): q L^4 / (8 E' I) + q L^2 / (2 k G A).
    const double q = 0.01 * 0.2, I = std::pow(0.2, 3) / 12.0;
    const double exact =
        q * 16.0 * (1.0 - nu * nu) / (8.0 * E * I) + q * 4.0 * 2.0 * (1.0 + nu) / (2.0 * 5.0 / 6.0 * E * 0.2);
    EXPECT_NEAR(sag, exact, 0.05 * exact) << on_cloud;
    // A period of its first bending mode, 2 pi / (1.875^2 sqrt(E' I / (rho A L^4))).
    const double period = 2.0 * std::numbers::pi / (3.516 * std::sqrt(E / (1.0 - nu * nu) * I / (0.2 * 16.0)));
    double ringing = 0.0;
    for (int k = 1; k <= 40; ++k) {
      dynamics.run(period * k / 40.0);
      ringing = std::max(ringing, (dynamics.nodes() - rest).colwise().norm().maxCoeff());
    }
    EXPECT_LT(ringing, 1e-4 * sag) << on_cloud;
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3) << on_cloud;
  }
}

TEST(Rest, ADiscThatStartsInItsRotationKeepsItsRadius) {
  constexpr double spin = 1.0, R = 1.0;
  const auto mesh = triangulate(shapes::annulus(0.1, R, 0.1), {.size = 0.1});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(), 1.0)}, otm<2>());
  const Points<2> start = dynamics.nodes();
  std::vector<Index> rim;
  for (Index a = 0; a < start.cols(); ++a)
    if (start.col(a).norm() > R - 1e-9) rim.push_back(a);
  dynamics.come_to_rest(1e-7, 1000000, Spin<2>(spin));
  const auto radius = [&] { return Vector(Points<2>(dynamics.nodes()(Eigen::all, rim)).colwise().norm().transpose()); };
  const Vector rest = radius();
  const double stretch = rest.mean() - R;
  // Rotating annulus in plane strain (Timoshenko & Goodier 1970, section 32), u at the outer radius.
  const double Ep = E / (1.0 - nu * nu), np = nu / (1.0 - nu), a2 = 0.01, b2 = 1.0;
  const double exact = spin * spin * R / (4.0 * Ep) * ((1.0 - np) * b2 + (3.0 + np) * a2);
  EXPECT_NEAR(stretch, exact, 0.02 * exact);
  double ringing = 0.0;
  for (int k = 1; k <= 20; ++k) {
    dynamics.run(0.5 * std::numbers::pi * k / 20.0);
    ringing = std::max(ringing, (radius() - rest).cwiseAbs().maxCoeff());
  }
  EXPECT_LT(ringing, 1e-4);  // of the radius
  EXPECT_LT(ringing, 0.1 * stretch);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-4);
  EXPECT_NEAR(dynamics.nodes().col(rim[0]).dot(Vec<2>(-start(1, rim[0]), start(0, rim[0]))), R, 1e-2);
}

TEST(Rest, KineticDampingBringsABlockToRestOnAWall) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  DynamicsOptions options;
  options.rest_from = 0.0;
  Dynamics<2> dynamics({deformable_body(mesh, rubber(), 1.0)}, otm<2>(), options);
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = 0.3});
  dynamics.set_gravity({0.0, -1.0});
  EXPECT_TRUE(std::isinf(dynamics.residual()));
  while (dynamics.time() < 20.0 && !(dynamics.steps() % 16 == 0 && dynamics.residual() < 1e-4)) dynamics.step();
  EXPECT_LT(dynamics.time(), 10.0);
  EXPECT_NEAR(dynamics.contacts().at(0).second.number, 0, 0);
  const double kinetic = 0.5 * dynamics.masses().dot(dynamics.velocities().colwise().squaredNorm());
  EXPECT_LT(kinetic, 1.01e-8 * dynamics.balance()["stored"]);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  // Weight above the middle.
  const double sag = 1.0 - dynamics.nodes().row(1).maxCoeff(), exact = (1.0 - nu * nu) / (2.0 * E);
  EXPECT_NEAR(sag, exact, 0.1 * exact);
}

TEST(Rest, KineticDampingOnACloudIsInTheEnergyBalance) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.05});
  DynamicsOptions options;
  options.rest_from = 0.0;
  Dynamics<2> dynamics({deformable_body(approximate(mesh, {.spacing = 0.15}), rubber(), 1.0)}, total_lagrangian<2>(),
                       options);
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  dynamics.set_gravity({0.0, -1.0});
  dynamics.run(1.0);
  const double kinetic = 0.5 * dynamics.masses().dot(dynamics.velocities().colwise().squaredNorm());
  EXPECT_LT(kinetic, 1e-3 * dynamics.balance()["stored"]);
  EXPECT_GT(dynamics.balance()["damping"], 0.1 * dynamics.balance()["stored"]);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
}

TEST(Rest, ACloudRestsOnARoughWall) {
  for (const auto& [size, spacing] : {std::pair(0.1, 0.13), std::pair(0.1, 0.15), std::pair(0.1, 0.2),
                                      std::pair(0.1, 0.25), std::pair(0.13, 0.17), std::pair(0.13, 0.25)}) {
    const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = size});
    for (const double friction : {0.1, 0.3, 0.6, 1.0}) {
      SCOPED_TRACE(testing::Message() << "friction " << friction << ", spacing " << spacing << ", mesh " << size);
      Dynamics<2> dynamics({deformable_body(approximate(mesh, {.spacing = spacing}), rubber(), 1.0)},
                           total_lagrangian<2>());
      dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0, .friction = friction});
      dynamics.set_gravity({0.0, -10.0});
      dynamics.come_to_rest(1e-7, 3000);
      const Points<2> rest = dynamics.nodes();
      const double sag = 1.0 - rest.row(1).maxCoeff(), exact = 10.0 * (1.0 - nu * nu) / (2.0 * E);
      EXPECT_NEAR(sag, exact, 0.15 * exact);
      dynamics.run(0.1);
      EXPECT_LT((dynamics.nodes() - rest).colwise().norm().maxCoeff(), 0.06 * sag) << "it creeps";
    }
  }
}

/// Sag of a square of side 1 at rest on a rough cylinder of radius 5, whose axis is parallel to its lower edge.
double sag_on_cylinder(DeformableBody<2> body, std::unique_ptr<Scheme<2>> scheme, double friction) {
  Dynamics<2> dynamics({std::move(body)}, std::move(scheme));
  dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>({0.5, -5.0}, 5.0), .friction = friction});
  dynamics.set_gravity({0.0, -10.0});
  dynamics.come_to_rest(1e-7, 5000);
  return 1.0 - dynamics.nodes().row(1).maxCoeff();
}

TEST(Rest, ACloudRestsOnARoughCylinder) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1}),
             fine = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.05});
  for (const double friction : {0.3, 0.6}) {
    const double nodes = sag_on_cylinder(deformable_body(fine, rubber(), 1.0), otm<2>(), friction);
    for (const double spacing : {0.13, 0.2}) {
      SCOPED_TRACE(testing::Message() << "friction " << friction << ", spacing " << spacing);
      const double cloud = sag_on_cylinder(deformable_body(approximate(mesh, {.spacing = spacing}), rubber(), 1.0),
                                           total_lagrangian<2>(), friction);
      EXPECT_NEAR(cloud, nodes, 0.05 * nodes);
    }
  }
}

TEST(Rest, ADiscRestsInARoughHollow) {
  constexpr double R = 0.4;
  constexpr int chords = 24;  // of half a circle, from the right to the left below
  const auto on_circle = [](int k) {
    const double angle = -std::numbers::pi * k / chords;
    return Vec<2>(R * std::cos(angle), R * std::sin(angle));
  };
  Polyline block{.name = "", .points = {{-1.0, 0.0}, {-1.0, -1.0}, {1.0, -1.0}, {1.0, 0.0}}}, disc;
  for (int k = 0; k <= chords; ++k) block.points.push_back(on_circle(k));
  for (int k = 0; k <= 2 * chords; ++k) disc.points.push_back(k == 2 * chords ? on_circle(0) : on_circle(k));
  block.points.push_back(block.points.front());
  std::vector<DeformableBody<2>> bodies;
  for (const Polyline& outline : {block, disc})
    bodies.push_back(deformable_body(triangulate({.boundary = {outline}}, {.size = 0.1}), rubber(), 1.0));
  Dynamics<2> dynamics(bodies, otm<2>(), {.contact = {.friction = 0.5}});
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = -1.0, .friction = 0.5});
  dynamics.set_gravity({0.0, -10.0});
  const Points<2> start = dynamics.nodes();
  dynamics.come_to_rest(1e-7, 5000);
  const Points<2> rest = dynamics.nodes();
  dynamics.run(1.0);
  const Index first = dynamics.first_node(1);
  const double weight = 10.0 * dynamics.masses().tail(dynamics.num_nodes() - first).sum();
  const auto& contacts = dynamics.contacts();
  ASSERT_EQ(contacts.size(), 2u);
  EXPECT_NEAR(contacts[0].impulse[1], -weight, 0.01 * weight);  // of the disc on the block
  EXPECT_LT((dynamics.nodes() - rest).colwise().norm().maxCoeff(), 0.06 * (start - rest).row(1).maxCoeff())
      << "it creeps";
}

TEST(Rest, ImpulsesOfContactBeginAfterAStaticStart) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.25});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(), 1.0)}, otm<2>());
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, 1.0}, -0.01)});
  dynamics.set_gravity({0.0, -10.0});
  dynamics.come_to_rest(1e-8, 100000);
  EXPECT_TRUE(dynamics.contacts().empty());
  EXPECT_EQ(dynamics.rigid_bodies()[0].impulse, Vec<2>(Vec<2>::Zero()));
  EXPECT_EQ(dynamics.rigid_bodies()[0].work, 0.0);
  dynamics.run(1.0);
  // The velocities, and so the impulses, are those of half a step ago.
  const double weight = 10.0 * dynamics.masses().sum(), time = 1.0 - 0.5 * dynamics.world().last_step;
  ASSERT_EQ(dynamics.contacts().size(), 1u);
  EXPECT_NEAR(dynamics.contacts()[0].impulse[1], weight * time, 1e-4 * weight);
  EXPECT_NEAR(dynamics.rigid_bodies()[0].impulse[1], -weight * time, 1e-4 * weight);
}

TEST(Rest, DampingByMassHasItsTerminalVelocity) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.5});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(), 1.0)}, otm<2>(), {.damping = 2.0});
  dynamics.set_gravity({0.0, -1.0});
  dynamics.run(1.0);
  EXPECT_NEAR(-dynamics.velocities().row(1).mean(), 0.5 * (1.0 - std::exp(-2.0)), 5e-3);
  dynamics.run(10.0);
  EXPECT_NEAR(-dynamics.velocities().row(1).mean(), 0.5, 1e-6);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3);
}

TEST(Rest, BodiesThatHaveNoPlaceToRestAreSaid) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.5});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(), 1.0)}, otm<2>());
  dynamics.set_gravity({0.0, -1.0});
  EXPECT_THAT([&] { dynamics.come_to_rest(1e-6, 200); },
              ThrowsMessage<NumericalError>(HasSubstr("not at rest after 200 steps")));
}

}  // namespace
}  // namespace efree
