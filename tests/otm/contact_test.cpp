// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"
#include "efree/otm/otm.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

/// Two of that body, which is about the origin, `reach` of it apart along x, that fly towards each other.
template <int Dim>
std::vector<OtmBody<Dim>> pair_of(const FineMesh<Dim>& mesh, double reach, double offset, double speed) {
  std::vector<OtmBody<Dim>> bodies;
  for (const double side : {-1.0, 1.0}) {
    OtmBody<Dim> body = otm_body(mesh, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0);
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
template <int Dim> double speed_of(const Otm<Dim>& otm, Index body) {
  double momentum = 0.0, mass = 0.0;
  for (Index a = otm.first_node(body); a < otm.first_node(body + 1); ++a) {
    momentum += otm.masses()[a] * otm.velocities()(0, a);
    mass += otm.masses()[a];
  }
  return momentum / mass;
}

template <int Dim> double gap_between(const Otm<Dim>& otm) {
  double gap = std::numeric_limits<double>::infinity();
  for (Index a = otm.first_node(0); a < otm.first_node(1); ++a)
    for (Index b = otm.first_node(1); b < otm.first_node(2); ++b)
      gap = std::min(gap, (otm.nodes().col(a) - otm.nodes().col(b)).norm());
  return gap;
}

/// Runs until then and expects that the bodies met, parted, kept both momenta to rounding and their energy to 1 %.
template <int Dim> void expect_bounce(Otm<Dim>& otm, double until, double speed) {
  const auto before = otm.balance();
  const double scale = otm.masses().sum() * speed;
  double nearest = std::numeric_limits<double>::infinity();
  for (int k = 1; k <= 20; ++k) {
    otm.run(until * k / 20.0);
    nearest = std::min(nearest, gap_between(otm));
  }
  const auto after = otm.balance();
  EXPECT_LT(nearest, 0.03);
  EXPECT_GT(gap_between(otm), 0.3);
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-11 * scale);
  EXPECT_LT((after.moment - before.moment).norm(), 1e-11 * scale);
  EXPECT_NEAR(after.total(), before.total(), 0.01 * before.total());
}

/// Without friction springs give back what they took, but for what steps of finite length make of their ends.
template <int Dim> void expect_given_back(const Otm<Dim>& otm) {
  EXPECT_GE(otm.balance().contact, 0.0);
  EXPECT_LT(otm.balance().contact, 3e-4 * otm.balance().total());
}

TEST(OtmContact, DisksBounceAndKeepMomentaAndEnergy) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  {
    Otm<2> otm(pair_of<2>(disk, 1.05, 0.0, 0.1));
    expect_bounce(otm, 12.0, 0.1);
    // Some of it goes on as vibration.
    EXPECT_NEAR(speed_of(otm, 0), -0.094, 0.002);
    EXPECT_NEAR(speed_of(otm, 1), 0.094, 0.002);
    expect_given_back(otm);
    EXPECT_EQ(otm.counts().passed, 0);
  }
  double spin = 0.0;
  for (const double friction : {0.0, 0.3}) {
    Otm<2> otm(pair_of<2>(disk, 1.05, 0.5, 0.1), {.contact = {.friction = friction}});
    expect_bounce(otm, 12.0, 0.1);
    double moment = 0.0;
    const Vec<2> centre = otm.nodes().leftCols(otm.first_node(1)).rowwise().mean();
    for (Index a = 0; a < otm.first_node(1); ++a) {
      const Vec<2> d = otm.nodes().col(a) - centre, v = otm.velocities().col(a);
      moment += otm.masses()[a] * (d[0] * v[1] - d[1] * v[0]);
    }
    if (friction == 0.0) {
      spin = moment;
      expect_given_back(otm);
    } else {
      EXPECT_GT(std::abs(moment), 5.0 * std::abs(spin));
      EXPECT_GT(otm.balance().contact, 1e-4);
    }
  }
}

TEST(OtmContact, PointsThatGetThroughASurfaceAreTold) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  Otm<2> otm(pair_of<2>(disk, 1.05, 0.0, 0.1), {.contact = {.stiffness = 1e-4}});
  otm.run(4.0);
  EXPECT_GT(otm.counts().passed, 20);
  EXPECT_LT(otm.counts().passed, otm.num_points());
}

TEST(OtmContact, SolidsBounceToo) {
  const FineMesh<3> box = FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.34));
  auto bodies = pair_of<3>(box, 0.55, 0.3, 0.1);
  Otm<3> otm(bodies, {.contact = {.friction = 0.2}});
  expect_bounce(otm, 8.0, 0.1);
}

/// Rings a tenth thick, blown up by a gas: a pressure of E / 500.
TEST(OtmContact, BalloonsBounce) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.9, 1.0, 0.05), {.size = 0.05});
  Otm<2> otm(pair_of<2>(ring, 1.05, 0.0, 0.02));
  std::vector<Index> inner;
  for (Index f = 0; f < ring.num_facets(); ++f)
    if (ring.vertex(ring.facets()(0, f)).norm() < 0.95) inner.push_back(f);
  for (Index body = 0; body < 2; ++body) {
    OtmCavity<2> gas{.facets = Facets<2>(2, static_cast<Eigen::Index>(inner.size())), .pressure = 0.002};
    for (std::size_t k = 0; k < inner.size(); ++k)
      gas.facets.col(static_cast<Eigen::Index>(k)) = ring.facets().col(inner[k]).array() + otm.first_node(body);
    otm.add_cavity(gas);
    if (body == 1) {
      gas.facets = gas.facets.leftCols(gas.facets.cols() - 1).eval();
      EXPECT_THAT([&] { otm.add_cavity(gas); }, ThrowsMessage<InputError>(HasSubstr("not closed")));
    }
  }
  expect_bounce(otm, 45.0, 0.02);
  EXPECT_NEAR(speed_of(otm, 0), -0.0185, 0.0005);
  EXPECT_NEAR(speed_of(otm, 0), -speed_of(otm, 1), 1e-4);
}

/// Runs two bodies that seize, and expects that both momenta and the energy stay, and that surfaces do not cross by
/// more than half of the spacing. Says how fast each body moved in the mean over the second half.
template <int Dim>
std::array<double, 2> expect_that_they_seize(Otm<Dim>& otm, double until, double spacing, double energy = 0.01) {
  const auto before = otm.balance();
  const double scale = std::sqrt(2.0 * before.kinetic * otm.masses().sum());
  const double mass = otm.masses().sum();
  const auto middle = [&](Index body) {
    const Index first = otm.first_node(body);
    return otm.nodes().row(0).segment(first, otm.first_node(body + 1) - first).mean();
  };
  std::array<double, 2> from{}, result{};
  double overlap = 0.0;
  for (int k = 1; k <= 40; ++k) {
    otm.run(until * k / 40.0);
    const Index first = otm.first_node(1);
    overlap = std::max(overlap, otm.nodes().row(0).head(first).maxCoeff() -
                                    otm.nodes().row(0).tail(otm.num_nodes() - first).minCoeff());
    if (k == 20) from = {middle(0), middle(1)};
  }
  for (const Index body : {0, 1}) result[body] = (middle(body) - from[body]) / (0.5 * until);
  EXPECT_LT(overlap, 0.5 * spacing);
  const auto after = otm.balance();
  EXPECT_LT((after.momentum - before.momentum).norm(), 1e-12 * scale);
  EXPECT_LT((after.moment - before.moment).norm(), 1e-11 * scale);
  EXPECT_NEAR(otm.masses().sum(), mass, 1e-12 * mass);
  EXPECT_NEAR(after.total(), before.total(), energy * before.kinetic);
  EXPECT_LT(gap_between(otm), 0.5 * spacing);
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
    Otm<2> otm(bodies, {.contact = {.seizing = true}});
    const auto speeds = expect_that_they_seize(otm, 60.0, 0.15, 0.015);
    EXPECT_NEAR(speeds[0], -0.05, 0.003);
    EXPECT_NEAR(speeds[1], -0.05, 0.003);
    const auto after = otm.balance();
    const double lost = after.dissipated + after.renewal;
    EXPECT_GE(after.kinetic, 0.005);
    if (is_metal) {
      EXPECT_LT(after.kinetic, 0.007);
      EXPECT_GT(lost, 0.012);
    } else {
      // It vibrates.
      EXPECT_NEAR(after.kinetic + after.stored + after.stabilising + after.renewal, 0.02, 3e-4);
    }
  }
}

TEST(OtmSeizing, DisksThatMeetOffTheirAxisTurnAsOne) {
  const FineMesh<2> disk = triangulate(shapes::annulus(0.05, 1.0, 0.15), {.size = 0.15});
  auto bodies = pair_of<2>(disk, 1.05, 0.5, 0.1);
  for (auto& body : bodies) body.material = rubber_or_metal(true);
  Otm<2> otm(bodies, {.contact = {.seizing = true}});
  const double moment = otm.balance().moment[0];
  otm.run(30.0);
  EXPECT_NEAR(otm.balance().moment[0], moment, 1e-11);
  EXPECT_NEAR(otm.balance().total(), 0.01 * 2.0 * otm.masses().sum() / 4.0, 0.01 * otm.balance().total());
  EXPECT_LT(gap_between(otm), 0.075);
  // Both turn about the common centre.
  const auto centre = [&](Index body) {
    const Index first = otm.first_node(body);
    return Vec<2>(otm.nodes().middleCols(first, otm.first_node(body + 1) - first).rowwise().mean());
  };
  const Vec<2> before = centre(1) - centre(0);
  otm.run(60.0);
  const Vec<2> now = centre(1) - centre(0);
  EXPECT_NEAR(now.norm(), before.norm(), 0.03);
  EXPECT_GT(std::abs(before[0] * now[1] - before[1] * now[0]), 0.3 * before.squaredNorm() * 0.1);
}

/// Functions change at once where they meet, half a step off: energy is off by the step.
TEST(OtmSeizing, SolidsSeizeToo) {
  auto bodies = pair_of<3>(FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.34)), 0.55, 0.0, 0.1);
  for (auto& body : bodies) body.material = rubber_or_metal(true);
  const auto off = [&](double courant, double bound) {
    Otm<3> otm(bodies, {.courant = courant, .contact = {.seizing = true}});
    const auto before = otm.balance();
    const auto speeds = expect_that_they_seize(otm, 16.0, 0.34, bound);
    EXPECT_NEAR(speeds[0], 0.0, 0.005);
    EXPECT_NEAR(speeds[1], 0.0, 0.005);
    return std::abs(otm.balance().total() / before.total() - 1.0);
  };
  const double coarse = off(0.5, 0.04);
  EXPECT_LT(off(0.25, 0.02), 0.7 * coarse);
}

TEST(OtmSeizing, GoesOnFromAStateBitwise) {
  const FineMesh<2> block = triangulate(shapes::rectangle(-0.5, -0.5, 0.5, 0.5), {.size = 0.2});
  const auto bodies = pair_of<2>(block, 0.55, 0.1, 0.1);
  const OtmOptions options{.contact = {.seizing = true}};
  Otm<2> one(bodies, options), other(bodies, options);
  one.run(1.0);
  other.restore(one.state());
  one.run(4.0);
  other.run(4.0);
  EXPECT_EQ(one.nodes(), other.nodes());
  EXPECT_EQ(one.cauchy_stress(), other.cauchy_stress());
  EXPECT_GT(one.counts().renewals, 0);
}

/// A gas in a box that is squeezed to half its length: p V^gamma.
TEST(OtmCavity, GasThatIsSqueezedTakesTheWorkOfItsAdiabate) {
  const FineMesh<2> ring = triangulate(shapes::annulus(0.9, 1.0, 0.2), {.size = 0.2});
  Otm<2> otm({otm_body(ring, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0)});
  std::vector<Index> inner;
  for (Index f = 0; f < ring.num_facets(); ++f)
    if (ring.vertex(ring.facets()(0, f)).norm() < 0.95) inner.push_back(f);
  OtmCavity<2> gas{.facets = Facets<2>(2, static_cast<Eigen::Index>(inner.size())), .pressure = 0.5, .exponent = 1.4};
  for (std::size_t k = 0; k < inner.size(); ++k)
    gas.facets.col(static_cast<Eigen::Index>(k)) = ring.facets().col(inner[k]);
  otm.add_cavity(gas);
  double area = 0.0;
  for (Eigen::Index f = 0; f < gas.facets.cols(); ++f) {
    const Vec<2> a = ring.vertex(gas.facets(0, f)), b = ring.vertex(gas.facets(1, f));
    area += 0.5 * std::abs(a[0] * b[1] - a[1] * b[0]);
  }
  for (Index a = 0; a < otm.num_nodes(); ++a) {
    otm.prescribe(a, 0, -0.5 * otm.nodes()(0, a));
    otm.prescribe(a, 1, 0.0);
  }
  while (otm.time() < 1.0 - 1e-12) otm.step(1.0 - otm.time());
  Otm<2> without({otm_body(ring, NeoHookean({.E = 1.0, .nu = 0.3}), 1.0)});
  for (Index a = 0; a < otm.num_nodes(); ++a) {
    without.prescribe(a, 0, -0.5 * without.nodes()(0, a));
    without.prescribe(a, 1, 0.0);
  }
  while (without.time() < 1.0 - 1e-12) without.step(1.0 - without.time());
  EXPECT_NEAR(otm.balance().stored - without.balance().stored, area * 0.5 / 0.4 * (std::pow(2.0, 0.4) - 1.0), 1e-9);
}

/// A bar thrown at a wall at a fifth of the speed of sound.
TEST(OtmShock, ViscosityTakesTheRingingAndAccountsForIt) {
  const auto run = [](ShockViscosity shock) {
    OtmBody<2> body = otm_body(triangulate(shapes::rectangle(0.0, 0.0, 4.0, 0.4), {.size = 0.1}),
                               NeoHookean({.E = 1.0, .nu = 0.0}), 1.0);
    body.velocity.setZero(2, body.nodes.cols());
    body.velocity.row(0).setConstant(-0.2);
    Otm<2> otm({body}, {.shock = shock});
    otm.add_wall({.normal = Vec<2>::Unit(0)});
    for (Index a = 0; a < otm.num_nodes(); ++a) otm.prescribe(a, 1, 0.0);
    const double before = otm.balance().total();
    otm.run(2.0);  // the wave is half way
    EXPECT_NEAR(otm.balance().total(), before, 0.01 * before);
    // Behind it all is at rest, and compressed by as much.
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (Index a = 0; a < otm.num_nodes(); ++a)
      if (otm.nodes()(0, a) < 1.2 && otm.nodes()(0, a) > 0.3) {
        sum += otm.velocities()(0, a);
        squares += std::pow(otm.velocities()(0, a), 2);
        ++count;
      }
    return std::array{sum / count, std::sqrt(squares / count), otm.balance().viscous};
  };
  const auto rings = run({}), calm = run({.linear = 0.06, .quadratic = 1.5});
  EXPECT_EQ(rings[2], 0.0);
  EXPECT_GT(calm[2], 0.0);
  EXPECT_NEAR(calm[0], 0.0, 0.01);
  EXPECT_LT(calm[1], 0.5 * rings[1]);
}

}  // namespace
}  // namespace efree
