// SPDX-License-Identifier: GPL-3.0-or-later
/// Total Lagrangian dynamics on coarse clouds: masses by a series, walls that act on the fine surface.
#include "efree/bench/elastic_block.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/mesh/largest_body.hpp"
#include "efree/geometry/meshing/image_mesh.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace efree {
namespace {

using bench::block;
using bench::soft;
using testing::HasSubstr;
using testing::ThrowsMessage;

template <int Dim> DeformableBody<Dim> on_cloud(double length, double spacing, const SharedMaterial& material) {
  return deformable_body(
      approximate(block<Dim>(length, spacing / 3.0), {.spacing = spacing, .support = dynamics_support}), material, 1.0);
}

template <int Dim> double deepest(const DeformableBody<Dim>& body, const Dynamics<Dim>& dynamics, int axis) {
  return interpolate(*body.surface, dynamics.nodes()).row(axis).minCoeff();
}

template <class T> class DynamicsOnClouds : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(DynamicsOnClouds, Dimensions);

TYPED_TEST(DynamicsOnClouds,
           ThrownAgainstARoughWallItsMomentumIsThatOfTheWallAndNoPointIsAHundredthOfASpacingBehindIt) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = on_cloud<Dim>(1.0, Dim == 2 ? 0.2 : 0.35, soft());
  const auto slid = [&](double friction) {
    body.velocity.setZero(Dim, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a) {
      body.velocity(0, a) = 0.1 - 0.1 * body.nodes(Dim - 1, a);
      body.velocity(Dim - 1, a) = -0.2 + 0.1 * body.nodes(0, a);
    }
    Dynamics<Dim> dynamics({body}, total_lagrangian<Dim>());
    dynamics.add_wall({.normal = Vec<Dim>::Unit(Dim - 1), .friction = friction});
    const auto before = dynamics.balance();
    Vec<Dim> impulse = Vec<Dim>::Zero();
    double last = 0.0, lowest = 0.0;
    while (dynamics.time() < 2.0) {
      const double dt = dynamics.step();
      impulse -= 0.5 * (dt + last) * dynamics.wall_forces().col(0);
      last = dt;
      lowest = std::min(lowest, deepest(body, dynamics, Dim - 1));
    }
    const auto after = dynamics.balance();
    EXPECT_LT((after.momentum - before.momentum - impulse).norm(), 1e-12 * before.momentum.norm());
    EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
    EXPECT_GT(after["contact"], 0.0);
    EXPECT_GT(lowest, -0.01 * (Dim == 2 ? 0.2 : 0.35));
    if (friction > 0.0) {
      EXPECT_LE(impulse.template head<Dim - 1>().norm(), friction * impulse[Dim - 1] * (1.0 + 1e-9));
    }
    return after.momentum[0] / before.momentum[0];
  };
  EXPECT_NEAR(slid(0.0), 1.0, 1e-12);
  EXPECT_LT(slid(0.1), 0.9);
  EXPECT_LT(slid(std::numeric_limits<double>::infinity()), slid(0.1));
}

TYPED_TEST(DynamicsOnClouds, AStepThatIsCutShortThrowsNothingOffTheWall) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = on_cloud<Dim>(1.0, Dim == 2 ? 0.2 : 0.35, soft());
  body.velocity = Vec<Dim>::Unit(0) * Vector::Constant(body.nodes.cols(), -0.1).transpose();
  Dynamics<Dim> dynamics({body}, total_lagrangian<Dim>());
  dynamics.add_wall({.normal = Vec<Dim>::Unit(0)});
  dynamics.run(0.5);
  ASSERT_LT(deepest(body, dynamics, 0), 0.0);
  const double lost = dynamics.balance()["contact"], thrown = 0.5 * 0.1 * 0.1;
  for (int k = 0; k < 3; ++k) {
    dynamics.step(1e-4 * dynamics.stable_step());
    dynamics.step();
  }
  EXPECT_NEAR(dynamics.balance()["contact"], lost, 0.02 * thrown);
}

TYPED_TEST(DynamicsOnClouds, FlyingAndSpinningItKeepsItsMomentaToRounding) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = on_cloud<Dim>(2.0, Dim == 2 ? 0.2 : 0.35, soft());
  body.velocity.setZero(Dim, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const auto x = body.nodes.col(a);
    body.velocity(0, a) = 0.2 - 0.5 * (x[1] - 0.5) + 0.25 * std::sin(3.0 * x[0]);
    body.velocity(1, a) = 0.1 + 0.5 * (x[0] - 1.0);
  }
  for (const Index terms : {1, 2, 3}) {
    body.mass_terms = terms;
    Dynamics<Dim> dynamics({body}, total_lagrangian<Dim>());
    EXPECT_NEAR(dynamics.masses().sum(), 2.0, 1e-12);
    const auto before = dynamics.balance();
    dynamics.run(3.0);
    const auto after = dynamics.balance();
    EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * before.momentum.norm()) << terms;
    EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-11 * before.angular_momentum.norm())
        << terms;
    EXPECT_NEAR(after.total(), before.total(), 0.005 * before.total()) << terms;
  }
}

/// Of points with their masses: m v^2 / 2 of the whole, and the energy of a rotation about the centre.
TYPED_TEST(DynamicsOnClouds, EnergiesOfRigidMotionsConvergeWithTheTermsOfTheMass) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = on_cloud<Dim>(2.0, Dim == 2 ? 0.2 : 0.35, soft());
  const auto turn = [](const Points<Dim>& at) {
    Points<Dim> velocity = Points<Dim>::Zero(Dim, at.cols());
    velocity.row(0) = 0.5 - at.row(1).array();
    velocity.row(1) = at.row(0).array() - 1.0;
    return velocity;
  };
  const double turning = 0.5 * turn(body.points).colwise().squaredNorm().dot(body.volumes);
  double last = std::numeric_limits<double>::infinity();
  for (const Index terms : {1, 2, 4}) {
    body.mass_terms = terms;
    body.velocity = Vec<Dim>::Unit(1) * Vector::Constant(body.nodes.cols(), 3.0).transpose();
    const auto flying = Dynamics<Dim>({body}, total_lagrangian<Dim>()).balance();
    EXPECT_NEAR(flying["kinetic"], 9.0, 1e-11);
    EXPECT_NEAR(flying.momentum[1], 6.0, 1e-11);
    body.velocity = turn(body.nodes);
    const double error = std::abs(Dynamics<Dim>({body}, total_lagrangian<Dim>()).balance()["kinetic"] / turning - 1.0);
    EXPECT_LT(error, 0.5 * last) << terms;
    last = error;
  }
  EXPECT_LT(last, 0.01);  // light nodes have got some mass of their neighbours
}

TYPED_TEST(DynamicsOnClouds, ResultsAreBitwiseTheSameOnAnyNumberOfThreadsAndFromAState) {
  constexpr int Dim = TypeParam::value;
  DeformableBody<Dim> body = on_cloud<Dim>(1.0, Dim == 2 ? 0.1 : 0.3, soft());
  body.velocity = -0.3 * body.nodes;
  const auto made = [&] {
    Dynamics<Dim> dynamics({body}, total_lagrangian<Dim>());
    dynamics.add_wall({.normal = Vec<Dim>::Unit(0), .friction = 0.3});
    dynamics.add_wall({.normal = Vec<Dim>::Unit(1), .level = -0.02});
    return dynamics;
  };
  const int before = num_threads();
  set_num_threads(1);
  Dynamics<Dim> straight = made(), threaded = made(), broken = made();
  straight.run(0.4);
  const std::string state = straight.state();
  straight.run(0.8);
  broken.restore(state);
  broken.run(0.8);
  set_num_threads(3);
  threaded.run(0.4);
  threaded.run(0.8);
  set_num_threads(before);
  EXPECT_GT(straight.balance()["contact"], 0.0);
  for (const Dynamics<Dim>* other : {&broken, &threaded}) {
    EXPECT_EQ(other->nodes(), straight.nodes());
    EXPECT_EQ(other->cauchy_stress(), straight.cauchy_stress());
    EXPECT_EQ(other->balance().total(), straight.balance().total());
    EXPECT_EQ(other->wall_forces(), straight.wall_forces());
  }
}

/// An elastic bar that hits a wall is at it for 2 L / c with the force rho c v A, and leaves as fast as it came.
TEST(BarOnACloud, BouncesOffAWallAfterTheTimeOfAWaveToAndFro) {
  const double length = 4.0, speed = 1e-3;
  DeformableBody<2> body = on_cloud<2>(length, 0.15, soft(0.0));
  body.velocity.setZero(2, body.nodes.cols());
  body.velocity.row(0).setConstant(-speed);
  Dynamics<2> dynamics({body}, total_lagrangian<2>());
  dynamics.add_wall({.normal = Vec<2>::Unit(0)});
  const double before = dynamics.balance().total();
  double last = 0.0, impulse = 0.0, first_half = 0.0, left_at = 0.0;
  while (dynamics.time() < 2.5 * length) {
    const double dt = dynamics.step(), given = -0.5 * (dt + last) * dynamics.wall_forces()(0, 0);
    impulse += given;
    if (dynamics.time() < length) first_half = impulse;
    if (given > 0.01 * speed * dt) left_at = dynamics.time();
    last = dt;
  }
  EXPECT_NEAR(first_half, speed * length, 0.02 * speed * length);
  EXPECT_NEAR(left_at, 2.0 * length, 0.04 * 2.0 * length);
  EXPECT_NEAR(impulse, 2.0 * speed * length, 0.03 * 2.0 * speed * length);
  EXPECT_NEAR(dynamics.balance().total(), before, 1e-3 * before);
  EXPECT_LT(dynamics.balance()["contact"], 0.05 * before);
}

/// The frequency of a free bar, u = cos(pi k x / L): Rayleigh's quotient of the mode.
/// A node in a corner has shape functions so negative that an eigenvalue of D^-1 M is just above 2, where four terms of
/// the mass are negative: its motion had a kinetic energy below zero and grew without end.
TEST(CloudMasses, ArePositiveOnACloudAsFineAsItsMesh) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.1});
  Dynamics<2> dynamics({deformable_body(approximate(mesh, {.spacing = 0.1, .support = dynamics_support}),
                                        NeoHookean({.E = 1e3, .nu = 0.3}), 1.0)},
                       total_lagrangian<2>());
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = 0.0});
  dynamics.set_gravity({0.0, -10.0});
  double least = 0.0, stored = 0.0;
  while (dynamics.time() < 0.8) {
    dynamics.step();
    least = std::min(least, dynamics.balance()["kinetic"]);
    stored = std::max(stored, dynamics.balance()["stored"]);
  }
  EXPECT_GT(least, -1e-3 * stored);
  EXPECT_LT(1.0 - dynamics.nodes().row(1).maxCoeff(), 0.02) << "twice the sag at rest";
  EXPECT_LT(dynamics.velocities().colwise().norm().maxCoeff(), 1.0);
}

TEST(BarOnACloud, WavesAreLessSlowTheMoreTermsTheMassHas) {
  const double length = 4.0;
  const int half_waves = 6;
  DeformableBody<2> body = on_cloud<2>(length, 0.2, soft(0.0));
  body.velocity.setZero(2, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a)
    body.velocity(0, a) = 1e-5 * std::cos(half_waves * std::numbers::pi * body.nodes(0, a) / length);
  // The mean of stored energy over that of kinetic energy is one in a free vibration: its period tells the frequency.
  const auto period = [&](Index terms) {
    body.mass_terms = terms;
    Dynamics<2> dynamics({body}, total_lagrangian<2>(), {.courant = 0.2});
    // Kinetic energy has minima at odd quarters of the period: the second one at three of them.
    double least = std::numeric_limits<double>::infinity(), at = 0.0;
    const double exact = 2.0 * length / half_waves;
    while (dynamics.time() < exact) {
      dynamics.step();
      const double kinetic = dynamics.balance()["kinetic"];
      if (dynamics.time() > 0.6 * exact && kinetic < least) {
        least = kinetic;
        at = dynamics.time();
      }
    }
    return at / 0.75 / exact - 1.0;
  };
  const double one = period(1), two = period(2), three = period(3);
  EXPECT_GT(one, 0.03);
  EXPECT_LT(std::abs(two), 0.5 * one) << one;
  EXPECT_LT(std::abs(three), std::abs(two) + 0.005);
}

/// Of a porous image, against explicit linear elements on its mesh: the impulse on the wall, and how long steps are.
TEST(ImageOnACloud, HitsAWallLikeTheFiniteElementsOfItsMeshWithLongerSteps) {
  const FineMesh<3> mesh(
      keep_largest(mesh_image<3>(random_spheres<3>(32, {.porosity = 0.3, .r_min = 4.0, .r_max = 8.0}), {.size = 2.0}))
          .mesh);
  const J2 metal({.moduli = {.E = 1.0, .nu = 0.3}, .yield = Hardening::linear(2e-3, 1e-3), .strain = Strain::finite});
  const auto thrown = [&](const ApproximationOptions& options) {
    DeformableBody<3> body = deformable_body(approximate(mesh, options), metal, 1.0);
    body.velocity.setZero(3, body.nodes.cols());
    body.velocity.row(2).setConstant(-4e-3);
    Dynamics<3> dynamics({body}, total_lagrangian<3>());
    dynamics.add_wall({.normal = Vec<3>::Unit(2)});
    const double step = dynamics.stable_step();
    dynamics.run(32.0);
    EXPECT_NEAR(dynamics.balance().total(), 0.5 * 16e-6 * body.volumes.sum(), 0.01 * 0.5 * 16e-6 * body.volumes.sum());
    return std::pair(dynamics.balance().momentum[2] + 4e-3 * body.volumes.sum(), step);
  };
  const auto [elements, short_step] = thrown({.kind = BasisKind::p1});
  const auto [cloud, long_step] =
      thrown({.spacing = 4.0, .support = dynamics_support, .dilatation = Dilatation::pointwise});
  EXPECT_NEAR(cloud, elements, 0.1 * elements);
  EXPECT_GT(long_step, 4.0 * short_step);
}

TEST(CloudInput, RefusesInvalidBodies) {
  const FineMesh<2> mesh = block<2>(1.0, 0.1);
  EXPECT_THAT([&] { deformable_body(approximate(mesh, {.kind = BasisKind::p2}), soft(), 1.0); },
              ThrowsMessage<InputError>(HasSubstr("quadratic finite elements")));
  EXPECT_THAT(
      [&] { deformable_body(approximate(mesh, {.spacing = 0.3, .dilatation = Dilatation::averaged}), soft(), 1.0); },
      ThrowsMessage<InputError>(HasSubstr("PressureKind::constant")));
  const DeformableBody<2> good = on_cloud<2>(1.0, 0.3, soft());
  const auto with = [&](const auto& change) {
    return [&good, change] {
      DeformableBody<2> body = good;
      change(body);
      Dynamics<2> dynamics({body}, total_lagrangian<2>());
    };
  };
  EXPECT_THAT(with([](auto& b) { b.mass_terms = 0; }), ThrowsMessage<InputError>(HasSubstr("0 terms of the mass")));
  EXPECT_THAT(with([](auto& b) { b.shape.reset(); }),
              ThrowsMessage<InputError>(HasSubstr("keeps given shape functions")));
  EXPECT_THAT(with([](auto& b) { b.surface.reset(); }), ThrowsMessage<InputError>(HasSubstr("points of a surface")));
  EXPECT_THAT(with([](auto& b) { b.surface = ShapeTable<2>(3, {0}, {}, {}); }),
              ThrowsMessage<InputError>(HasSubstr("3 nodes on the surface")));
  EXPECT_THAT([&] { Dynamics<2>({good}, otm<2>()); }, ThrowsMessage<InputError>(HasSubstr("total Lagrangian")));
}

}  // namespace
}  // namespace efree
