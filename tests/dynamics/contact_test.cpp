// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/bench/contact_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

/// Two of that body, which is about the origin, `reach` of it apart along x, that fly towards each other.
template <int Dim>
std::vector<DeformableBody<Dim>> pair_of(const FineMesh<Dim>& mesh, double reach, double offset, double speed) {
  std::vector<DeformableBody<Dim>> bodies;
  for (const double side : {-1.0, 1.0}) {
    DeformableBody<Dim> body = deformable_body(mesh, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0);
    Vec<Dim> centre = Vec<Dim>::Zero();
    centre[0] = side * reach;
    centre[1] = 0.5 * (side + 1.0) * offset;
    body.nodes.colwise() += centre;
    body.points.colwise() += centre;
    body.velocity.setZero(Dim, body.nodes.cols());
    body.velocity.row(0).setConstant(-side * speed);
    bodies.push_back(std::move(body));
  }
  return bodies;
}

/// Mean velocity of a body along x.
template <int Dim> double speed_of(const Dynamics<Dim>& dynamics, Index body) {
  double momentum = 0.0, mass = 0.0;
  for (Index a = dynamics.first_node(body); a < dynamics.first_node(body + 1); ++a) {
    momentum += dynamics.masses()[a] * dynamics.velocities()(0, a);
    mass += dynamics.masses()[a];
  }
  return momentum / mass;
}

template <int Dim> double gap_between(const Dynamics<Dim>& dynamics) {
  double gap = std::numeric_limits<double>::infinity();
  for (Index a = dynamics.first_node(0); a < dynamics.first_node(1); ++a)
    for (Index b = dynamics.first_node(1); b < dynamics.first_node(2); ++b)
      gap = std::min(gap, (dynamics.nodes().col(a) - dynamics.nodes().col(b)).norm());
  return gap;
}

/// Runs until then and expects that the bodies met, parted, kept both momenta to rounding and their energy to 1 %.
template <int Dim> void expect_bounce(Dynamics<Dim>& dynamics, double until, double speed) {
  const auto before = dynamics.balance();
  const double scale = dynamics.masses().sum() * speed;
  double nearest = std::numeric_limits<double>::infinity();
  for (int k = 1; k <= 20; ++k) {
    dynamics.run(until * k / 20.0);
    nearest = std::min(nearest, gap_between(dynamics));
  }
  const auto after = dynamics.balance();
  EXPECT_LT(nearest, 0.03);
  EXPECT_GT(gap_between(dynamics), 0.3);
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-11 * scale);
  EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-11 * scale);
  EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
}

/// Without friction contact loses the energy of the nodes that are stopped first, and nothing more.
template <int Dim> void expect_given_back(const Dynamics<Dim>& dynamics, double lost) {
  EXPECT_GT(dynamics.balance()["contact"], 0.0);
  EXPECT_LT(dynamics.balance()["contact"], lost * dynamics.balance().total());
}

TEST(BodyContact, DisksBounceAndKeepMomentaAndEnergy) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  {
    Dynamics<2> dynamics(pair_of<2>(disk, 1.05, 0.0, 0.1), otm<2>());
    expect_bounce(dynamics, 12.0, 0.1);
    // Some of it goes on as vibration.
    EXPECT_NEAR(speed_of(dynamics, 0), -0.094, 0.002);
    EXPECT_NEAR(speed_of(dynamics, 1), 0.094, 0.002);
    expect_given_back(dynamics, 0.02);
    EXPECT_EQ(dynamics.count("penetrated points"), 0);
  }
  double spin = 0.0;
  for (const double friction : {0.0, 0.3}) {
    Dynamics<2> dynamics(pair_of<2>(disk, 1.05, 0.5, 0.1), otm<2>(), {.contact = {.friction = friction}});
    expect_bounce(dynamics, 12.0, 0.1);
    double moment = 0.0;
    const Vec<2> centre = dynamics.nodes().leftCols(dynamics.first_node(1)).rowwise().mean();
    for (Index a = 0; a < dynamics.first_node(1); ++a) {
      const Vec<2> d = dynamics.nodes().col(a) - centre, v = dynamics.velocities().col(a);
      moment += dynamics.masses()[a] * (d[0] * v[1] - d[1] * v[0]);
    }
    if (friction == 0.0) {
      spin = moment;
      expect_given_back(dynamics, 0.02);
    } else {
      EXPECT_GT(std::abs(moment), 5.0 * std::abs(spin));
      EXPECT_GT(dynamics.balance()["contact"], 1e-4);
    }
  }
}

TEST(BodyContact, PointsThatPenetrateASurfaceAreCounted) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  // So deep that they count as being on the other side.
  Dynamics<2> dynamics(pair_of<2>(disk, 0.8, 0.0, 0.0), otm<2>());
  dynamics.run(8.0);
  EXPECT_GT(dynamics.count("penetrated points"), 20);
  EXPECT_LT(dynamics.count("penetrated points"), dynamics.num_points());
}

/// Closed form of a mass on a neo-Hookean spring.
TEST(BodyContact, AHeavyBlockOnASoftColumnFeelsTheStiffnessOfTheColumnAlone) {
  const bench::Column column = bench::press_column(4);
  EXPECT_NEAR(column.sag, 1.0, 0.005);
  EXPECT_NEAR(column.period, 1.0, 0.005);
  EXPECT_LT(column.penetration, 0.02);
  EXPECT_NEAR(column.step, 1.0, 0.01);
  EXPECT_LT(std::abs(column.energy_error), 1e-4);
}

TEST(BodyContact, ABlockOnTheSlopeOfAnotherBodySlidesLikeARigidOneOrRests) {
  const auto sliding = bench::slide_down({.slope = bench::Slope::body, .friction = 0.5});
  EXPECT_NEAR(sliding.speed, sliding.rigid_speed, 0.02 * sliding.rigid_speed);
  EXPECT_LT(std::abs(sliding.energy_error), 1e-3);
  const auto resting = bench::slide_down({.slope = bench::Slope::body, .friction = 0.6});
  EXPECT_NEAR(resting.speed, 0.0, 1e-3 * resting.free_speed);
}

/// Its corner slips from facet to facet, and is inside the next one at once.
/// A square of side 1 at rest on another one, without friction and held along x by its upper edge, which is `offset`
/// away from that of the one below: the force of contact on it along x over its weight, and the potential energy.
std::pair<double, double> shifted_square(double offset) {
  std::vector<DeformableBody<2>> bodies;
  for (const auto& [bottom, size] : {std::pair(0.0, 0.2), std::pair(1.0, 0.16)})
    bodies.push_back(deformable_body(triangulate(shapes::rectangle(-0.5, bottom, 0.5, bottom + 1.0), {.size = size}),
                                     NeoHookean({.E = 100.0, .nu = 0.3}), 1.0));
  bodies[1].nodes.row(0).array() += offset;
  bodies[1].points.row(0).array() += offset;
  Dynamics<2> dynamics(bodies, otm<2>(), {.damping = 5.0});
  for (const int axis : {0, 1}) dynamics.prescribe([](const Vec<2>& x) { return x[1] < 1e-9; }, axis, 0.0);
  dynamics.prescribe([](const Vec<2>& x) { return x[1] > 2.0 - 1e-9; }, 0, 0.0);
  dynamics.set_gravity({0.0, -1.0});
  const Points<2> start = dynamics.nodes();
  dynamics.run(6.0);
  const auto before = dynamics.contacts()[0].impulse;
  const double from = dynamics.time();
  dynamics.run(6.5);
  const Vec<2> force = (before - dynamics.contacts()[0].impulse) / (dynamics.time() - from);
  EXPECT_NEAR(force[1], 1.0, 1e-3);
  const auto energies = dynamics.balance();
  return {force[0],
          energies["stored"] + energies["stabilisation"] + dynamics.masses().dot((dynamics.nodes() - start).row(1))};
}

/// It slides off, as both sag more: its equilibrium is unstable. Nothing else makes it slide.
TEST(BodyContact, ABlockWithoutFrictionIsPushedAlongAnotherByTheEnergyThatThisReleasesAlone) {
  EXPECT_NEAR(shifted_square(0.0).first, 0.0, 1e-4);
  const auto [force, energy] = shifted_square(0.02);
  const auto [more_force, less_energy] = shifted_square(0.04);
  EXPECT_NEAR(0.5 * (force + more_force), (energy - less_energy) / 0.02, 0.02 * more_force);
  EXPECT_NEAR(force, 2.1e-3, 0.3e-3);  // on a quarter of the spacing 2.3e-3
}

TEST(BodyContact, ACornerThatHitsABlockGetsNoEnergyFromContact) {
  const auto rubber = [](double E) { return NeoHookean({.E = E, .nu = 0.3}); };
  std::vector<DeformableBody<2>> bodies{
      deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.4), {.size = 0.05}), rubber(1e7), 1000.0),
      deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 0.4, 0.4), {.size = 0.05}), rubber(1e8), 1000.0)};
  const Mat<2> turn = Eigen::Rotation2Dd(std::numbers::pi / 4.0).toRotationMatrix();
  for (Points<2>* x : {&bodies[1].nodes, &bodies[1].points}) *x = (turn * *x).colwise() + Vec<2>(0.512, 0.41);
  bodies[1].velocity = Vec<2>(0.0, -5.0).replicate(1, bodies[1].nodes.cols());
  Dynamics<2> dynamics(bodies, otm<2>());
  bench::hold_below(0.0, dynamics);
  const double before = dynamics.balance()["kinetic"];
  while (dynamics.time() < 0.03) {
    dynamics.step();
    ASSERT_GT(dynamics.balance()["contact"], -0.01 * before);
    ASSERT_LT(dynamics.balance()["contact"], 0.1 * before);
  }
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 1e-3);
}

TEST(BodyContact, SolidsBounceToo) {
  const FineMesh<3> box = FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.34));
  auto bodies = pair_of<3>(box, 0.55, 0.3, 0.1);
  Dynamics<3> dynamics(bodies, otm<3>(), {.contact = {.friction = 0.2}});
  expect_bounce(dynamics, 8.0, 0.1);
}

/// Rings a tenth thick, blown up by a gas: a pressure of E / 500.
TEST(BodyContact, BalloonsBounce) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.9, 1.0, 0.05), {.size = 0.05});
  Dynamics<2> dynamics(pair_of<2>(ring, 1.05, 0.0, 0.02), otm<2>());
  std::vector<Index> inner;
  for (Index f = 0; f < ring.num_facets(); ++f)
    if (ring.vertex(ring.facets()(0, f)).norm() < 0.95) inner.push_back(f);
  for (Index body = 0; body < 2; ++body) {
    GasCavity<2> gas{.facets = Facets<2>(2, static_cast<Eigen::Index>(inner.size())), .pressure = 0.002};
    for (std::size_t k = 0; k < inner.size(); ++k)
      gas.facets.col(static_cast<Eigen::Index>(k)) = ring.facets().col(inner[k]).array() + dynamics.first_node(body);
    dynamics.add_cavity(gas);
    if (body == 1) {
      gas.facets = gas.facets.leftCols(gas.facets.cols() - 1).eval();
      EXPECT_THAT([&] { dynamics.add_cavity(gas); }, ThrowsMessage<InputError>(HasSubstr("not closed")));
    }
  }
  expect_bounce(dynamics, 45.0, 0.02);
  EXPECT_NEAR(speed_of(dynamics, 0), -0.0185, 0.0005);
  EXPECT_NEAR(speed_of(dynamics, 0), -speed_of(dynamics, 1), 1e-4);
}

/// Runs two bodies that seize, and expects that both momenta and the energy stay, and that surfaces do not cross by
/// more than half of the spacing. Returns the mean velocity of each body over the second half.
template <int Dim> std::array<double, 2> expect_that_they_seize(Dynamics<Dim>& dynamics, double until, double spacing,
                                                                double energy = 0.01) {
  const auto before = dynamics.balance();
  const double scale = std::sqrt(2.0 * before["kinetic"] * dynamics.masses().sum());
  const double mass = dynamics.masses().sum();
  const auto middle = [&](Index body) {
    const Index first = dynamics.first_node(body);
    return dynamics.nodes().row(0).segment(first, dynamics.first_node(body + 1) - first).mean();
  };
  std::array<double, 2> from{}, result{};
  double overlap = 0.0;
  for (int k = 1; k <= 40; ++k) {
    dynamics.run(until * k / 40.0);
    const Index first = dynamics.first_node(1);
    overlap = std::max(overlap, dynamics.nodes().row(0).head(first).maxCoeff() -
                                    dynamics.nodes().row(0).tail(dynamics.num_nodes() - first).minCoeff());
    if (k == 20) from = {middle(0), middle(1)};
  }
  for (const Index body : {0, 1}) result[body] = (middle(body) - from[body]) / (0.5 * until);
  EXPECT_LT(overlap, 0.5 * spacing);
  const auto after = dynamics.balance();
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * scale);
  EXPECT_LT((after.angular_momentum - before.angular_momentum).norm(), 1e-11 * scale);
  EXPECT_NEAR(dynamics.masses().sum(), mass, 1e-12 * mass);
  EXPECT_NEAR(after.total(), before.total(), energy * before["kinetic"]);
  EXPECT_LT(gap_between(dynamics), 0.5 * spacing);
  return result;
}

SharedMaterial rubber_or_metal(bool is_metal) {
  if (is_metal) return J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = 0.02, .strain = Strain::finite});
  return NeoHookean({.E = 1.0, .nu = 0.3});
}

/// Blocks of mass 1 at 0.1 and of mass 3 at -0.1 have -0.05 in common, and 0.005 of their energy of 0.02.
TEST(OtmSeizing, BlocksThatMeetMoveOnAsOne) {
  const FineMesh<2> block = triangulate(shapes::rectangle(-0.5, -0.5, 0.5, 0.5), {.size = 0.15});
  for (const bool is_metal : {false, true}) {
    auto bodies = pair_of<2>(block, 0.55, 0.0, 0.1);
    for (auto& body : bodies) body.material = rubber_or_metal(is_metal);
    bodies[1].density = 3.0;
    Dynamics<2> dynamics(bodies, otm<2>({.seizing = true}), {.contact = {.enabled = false}});
    const auto speeds = expect_that_they_seize(dynamics, 60.0, 0.15, 0.015);
    EXPECT_NEAR(speeds[0], -0.05, 0.003);
    EXPECT_NEAR(speeds[1], -0.05, 0.003);
    const auto after = dynamics.balance();
    const double lost = after["dissipated"] + after["reconnection"];
    EXPECT_GE(after["kinetic"], 0.005);
    if (is_metal) {
      EXPECT_LT(after["kinetic"], 0.007);
      EXPECT_GT(lost, 0.012);
    } else {
      // It vibrates.
      EXPECT_NEAR(after["kinetic"] + after["stored"] + after["stabilisation"] + after["reconnection"], 0.02, 3e-4);
    }
  }
}

TEST(OtmSeizing, DisksThatMeetOffTheirAxisTurnAsOne) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  auto bodies = pair_of<2>(disk, 1.05, 0.5, 0.1);
  for (auto& body : bodies) body.material = rubber_or_metal(true);
  Dynamics<2> dynamics(bodies, otm<2>({.seizing = true}), {.contact = {.enabled = false}});
  const double moment = dynamics.balance().angular_momentum[0];
  dynamics.run(30.0);
  EXPECT_NEAR(dynamics.balance().angular_momentum[0], moment, 1e-11);
  EXPECT_NEAR(dynamics.balance().total(), 0.01 * 2.0 * dynamics.masses().sum() / 4.0,
              0.01 * dynamics.balance().total());
  EXPECT_LT(gap_between(dynamics), 0.075);
  // Both turn about the common centre.
  const auto centre = [&](Index body) {
    const Index first = dynamics.first_node(body);
    return Vec<2>(dynamics.nodes().middleCols(first, dynamics.first_node(body + 1) - first).rowwise().mean());
  };
  const Vec<2> before = centre(1) - centre(0);
  dynamics.run(60.0);
  const Vec<2> now = centre(1) - centre(0);
  EXPECT_NEAR(now.norm(), before.norm(), 0.03);
  EXPECT_GT(std::abs(before[0] * now[1] - before[1] * now[0]), 0.3 * before.squaredNorm() * 0.1);
}

/// Shape functions change at once where bodies meet, half a step off: the error of energy is in proportion to the step.
TEST(OtmSeizing, SolidsSeizeToo) {
  auto bodies = pair_of<3>(FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.34)), 0.55, 0.0, 0.1);
  for (auto& body : bodies) body.material = rubber_or_metal(true);
  const auto off = [&](double courant, double bound) {
    Dynamics<3> dynamics(bodies, otm<3>({.seizing = true}), {.courant = courant, .contact = {.enabled = false}});
    const auto before = dynamics.balance();
    const auto speeds = expect_that_they_seize(dynamics, 16.0, 0.34, bound);
    EXPECT_NEAR(speeds[0], 0.0, 0.005);
    EXPECT_NEAR(speeds[1], 0.0, 0.005);
    return std::abs(dynamics.balance().total() / before.total() - 1.0);
  };
  const double coarse = off(0.5, 0.04);
  EXPECT_LT(off(0.25, 0.02), 0.7 * coarse);
}

TEST(OtmSeizing, GoesOnFromAStateBitwise) {
  const FineMesh<2> block = triangulate(shapes::rectangle(-0.5, -0.5, 0.5, 0.5), {.size = 0.2});
  const auto bodies = pair_of<2>(block, 0.55, 0.1, 0.1);
  const DynamicsOptions options{.contact = {.enabled = false}};
  Dynamics<2> one(bodies, otm<2>({.seizing = true}), options), other(bodies, otm<2>({.seizing = true}), options);
  one.run(1.0);
  other.restore(one.state());
  one.run(4.0);
  other.run(4.0);
  EXPECT_EQ(one.nodes(), other.nodes());
  EXPECT_EQ(one.cauchy_stress(), other.cauchy_stress());
  EXPECT_GT(one.count("reconnections"), 0);
}

/// A gas in a box that is compressed to half its length: p V^gamma.
TEST(GasCavity, CompressionStoresTheWorkOfTheAdiabate) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.9, 1.0, 0.2), {.size = 0.2});
  Dynamics<2> dynamics({deformable_body(ring, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0)}, otm<2>());
  std::vector<Index> inner;
  for (Index f = 0; f < ring.num_facets(); ++f)
    if (ring.vertex(ring.facets()(0, f)).norm() < 0.95) inner.push_back(f);
  GasCavity<2> gas{.facets = Facets<2>(2, static_cast<Eigen::Index>(inner.size())), .pressure = 0.5, .exponent = 1.4};
  for (std::size_t k = 0; k < inner.size(); ++k)
    gas.facets.col(static_cast<Eigen::Index>(k)) = ring.facets().col(inner[k]);
  dynamics.add_cavity(gas);
  double area = 0.0;
  for (Eigen::Index f = 0; f < gas.facets.cols(); ++f) {
    const Vec<2> a = ring.vertex(gas.facets(0, f)), b = ring.vertex(gas.facets(1, f));
    area += 0.5 * std::abs(a[0] * b[1] - a[1] * b[0]);
  }
  for (Index a = 0; a < dynamics.num_nodes(); ++a) {
    dynamics.prescribe(a, 0, -0.5 * dynamics.nodes()(0, a));
    dynamics.prescribe(a, 1, 0.0);
  }
  while (dynamics.time() < 1.0 - 1e-12) dynamics.step(1.0 - dynamics.time());
  Dynamics<2> without({deformable_body(ring, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0)}, otm<2>());
  for (Index a = 0; a < dynamics.num_nodes(); ++a) {
    without.prescribe(a, 0, -0.5 * without.nodes()(0, a));
    without.prescribe(a, 1, 0.0);
  }
  while (without.time() < 1.0 - 1e-12) without.step(1.0 - without.time());
  EXPECT_NEAR(dynamics.balance()["stored"] - without.balance()["stored"], area * 0.5 / 0.4 * (std::pow(2.0, 0.4) - 1.0),
              1e-9);
}

/// A bar thrown at a wall at a fifth of the speed of sound.
TEST(ShockViscosity, DampsRingingAndItsHeatIsInTheBalance) {
  const auto run = [](ShockViscosity shock) {
    DeformableBody<2> body = deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 4.0, 0.4), {.size = 0.1}),
                                             NeoHookean({.E = 1.0, .nu = 0.0}), 1.0);
    body.velocity.setZero(2, body.nodes.cols());
    body.velocity.row(0).setConstant(-0.2);
    Dynamics<2> dynamics({body}, otm<2>(), {.shock = shock});
    dynamics.add_wall({.normal = Vec<2>::Unit(0)});
    for (Index a = 0; a < dynamics.num_nodes(); ++a) dynamics.prescribe(a, 1, 0.0);
    const double before = dynamics.balance().total();
    dynamics.run(2.0);  // the wave is half way
    EXPECT_NEAR(dynamics.balance().total(), before, 0.01 * before);
    // Behind it all is at rest, and compressed by as much.
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (Index a = 0; a < dynamics.num_nodes(); ++a)
      if (dynamics.nodes()(0, a) < 1.2 && dynamics.nodes()(0, a) > 0.3) {
        sum += dynamics.velocities()(0, a);
        squares += std::pow(dynamics.velocities()(0, a), 2);
        ++count;
      }
    return std::array{sum / count, std::sqrt(squares / count), dynamics.balance()["viscous"]};
  };
  const auto rings = run({}), calm = run({.linear = 0.06, .quadratic = 1.5});
  EXPECT_EQ(rings[2], 0.0);
  EXPECT_GT(calm[2], 0.0);
  EXPECT_NEAR(calm[0], 0.0, 0.01);
  EXPECT_LT(calm[1], 0.5 * rings[1]);
}

}  // namespace
}  // namespace efree
