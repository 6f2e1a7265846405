// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
#include "efree/materials/j2.hpp"

#include "../../bench/cracked_strip.hpp"
#include "../../bench/perforation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

/// A square or cube of side 1 whose nodes move as F' = rate (stretch along y).
template <int Dim> DeformableBody<Dim> pulled(const FractureCriteria& fracture, double rate, SharedMaterial material) {
  FineMesh<Dim> mesh = [] {
    if constexpr (Dim == 2)
      return triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2});
    else
      return FineMesh<3>(solids::box({1.0, 1.0, 1.0}, 0.34));
  }();
  DeformableBody<Dim> body = deformable_body(mesh, std::move(material), 1.0);
  body.fracture = fracture;
  body.velocity.setZero(Dim, body.nodes.cols());
  body.velocity.row(1) = rate * body.nodes.row(1);
  return body;
}
template <int Dim> void hold(Dynamics<Dim>& dynamics, const DeformableBody<Dim>& body) {
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    for (int i = 0; i < Dim; ++i) dynamics.prescribe(a, i, body.velocity(i, a));
}
SharedMaterial soft() {
  return NeoHookean({.E = 1.0, .nu = 0.3});
}

template <int Dim> void expect_kept(Plane plane) {
  // Pulled, and off the axis turning, and let go; then a line of points breaks.
  DeformableBody<Dim> body = pulled<Dim>({}, 0.05, soft());
  if (plane == Plane::strain) body.velocity.row(0) += 0.1 * body.nodes.row(1);
  Dynamics<Dim> dynamics({body}, otm<Dim>(), {.plane = plane});
  dynamics.run(0.5);
  const auto before = dynamics.balance();
  const Vector masses = dynamics.masses();
  const Points<Dim> v = dynamics.velocities();
  const Points<Dim> at = dynamics.points();
  for (Index p = 0; p < dynamics.num_points(); ++p)
    if (std::abs(at(1, p) - 0.5) < 0.15) dynamics.erode(p);
  ASSERT_GT(dynamics.count("eroded points"), 3);
  ASSERT_LT(dynamics.count("eroded points"), dynamics.num_points() / 2);
  const auto after = dynamics.balance();
  EXPECT_EQ(dynamics.masses(), masses);
  EXPECT_EQ(dynamics.velocities(), v);
  EXPECT_GT(after["fracture"], 0.0);
  EXPECT_LT(after["stored"], before["stored"]);
  EXPECT_NEAR(after.total(), before.total(), 1e-12 * before.total());
  // And stay: the parts fly on.
  dynamics.run(2.0);
  const auto end = dynamics.balance();
  EXPECT_NEAR(dynamics.masses().sum(), masses.sum(), 1e-12 * masses.sum());
  EXPECT_LT(std::abs(end.momentum[1] - before.momentum[1]), 1e-12 * before.momentum.norm());
  EXPECT_NEAR(end.total(), before.total(), 0.01 * before.total());
}

TEST(Erosion, PointsThatBreakLeaveMassAndMomentumAndTakeTheirEnergy) {
  expect_kept<2>(Plane::strain);
  expect_kept<2>(Plane::axisymmetric);
  expect_kept<3>(Plane::strain);
}

TEST(Erosion, ACrackBeginsToGrowAtItsToughness) {
  bench::CrackedStrip strip(0.04, 2.0, 15.0);
  const double first = strip.onset().first;
  EXPECT_NEAR(first, 1.0, 0.1);  // the load by its square root, to 5 per cent
  // A point alone says too little.
  EXPECT_GT(bench::CrackedStrip(0.04, 0.0, 15.0).onset().first, 1.25);
}

TEST(Erosion, ReleaseRatesOfUniformTensionAreThoseOfTheBall) {
  const double rate = 0.01;
  const DeformableBody<2> body = pulled<2>({.toughness = 1e9}, rate, soft());
  Dynamics<2> dynamics({body}, otm<2>());
  hold(dynamics, body);
  dynamics.run(1.0);
  // E and nu of uniaxial strain, to first order in the strain; C = 4 pi (1 - nu) / (5/2 - 4 nu).
  const double energy = 0.5 * bench::CrackedStrip::modulus * rate * rate;
  const double factor = 4.0 * std::numbers::pi * 0.7 / 1.3;
  // Spacings of nodes are those of the mesh, about 0.75 of its longest edge.
  const double mean = dynamics.release_rates().mean();
  EXPECT_NEAR(mean / (factor * 2.0 * energy * 0.15), 1.0, 0.15);
  EXPECT_GT(dynamics.release_rates().minCoeff(), 0.0);
}

TEST(Erosion, CompressionDoesNotBreak) {
  for (const double rate : {0.05, -0.05}) {
    const DeformableBody<2> body = pulled<2>({.toughness = 1e-4}, rate, soft());
    Dynamics<2> dynamics({body}, otm<2>());
    hold(dynamics, body);
    dynamics.run(1.0);
    EXPECT_EQ(dynamics.count("eroded points") > 0, rate > 0.0);
    if (rate < 0.0) {
      EXPECT_EQ(dynamics.release_rates().maxCoeff(), 0.0);
    }
  }
}

TEST(Erosion, AllPointsBreakAtTheStretchTheyBear) {
  const DeformableBody<2> body = pulled<2>({.stretch = 1.2}, 0.1, soft());
  Dynamics<2> dynamics({body}, otm<2>());
  hold(dynamics, body);
  dynamics.run(1.9);
  EXPECT_EQ(dynamics.count("eroded points"), 0);
  dynamics.run(2.1);
  EXPECT_EQ(dynamics.count("eroded points"), dynamics.num_points());
}

TEST(FailureStrain, IsTheLawThatWasAskedFor) {
  const FailureStrain metal(JohnsonCookFailure{.D = {0.2, 0.5, -0.4, 0.1, 2.0}, .reference = 1e-3, .melting = 1000.0});
  EXPECT_DOUBLE_EQ(metal.at(0.5, 0.1, 250.0),
                   (0.2 + 0.5 * std::exp(-0.2)) * (1.0 + 0.1 * std::log(100.0)) * (1.0 + 2.0 * 0.25));
  EXPECT_DOUBLE_EQ(metal.at(0.5, 1e-6, 0.0), 0.2 + 0.5 * std::exp(-0.2)) << "rates count from the reference on";
  const FailureStrain table = FailureStrain::table({-0.5, 0.0, 1.5}, {2.0, 0.6, 0.3});
  EXPECT_DOUBLE_EQ(table.at(-0.25, 1.0, 0.0), 1.3);
  EXPECT_DOUBLE_EQ(table.at(0.5, 1e3, 500.0), 0.5);
  EXPECT_EQ(table.at(-7.0, 1.0, 0.0), 2.0);
  EXPECT_EQ(table.at(7.0, 1.0, 0.0), 0.3);
  EXPECT_EQ(table.at(std::numeric_limits<double>::infinity(), 1.0, 0.0), 0.3) << "no shear stress";
}

constexpr double E = 100.0, nu = 0.3, yield = 1.0;  // of a metal that does not harden
SharedMaterial metal() {
  return J2({.moduli = {.E = E, .nu = nu}, .yield = Hardening::linear(yield, 0.0), .strain = Strain::finite});
}
/// Uniaxial strain yields where 2 G ln V is the yield stress; the plastic strain is 2/3 (ln V - that) from then on.
constexpr double first_flow = yield / (E / (1.0 + nu));

/// Uniaxial strain at a steady rate: the plastic strain is known, and so is the mean stress over von Mises'.
template <int Dim> void expect_damage(const FailureStrain& law) {
  const double rate = 0.1;
  const DeformableBody<Dim> body = pulled<Dim>({.strain = law}, rate, metal());
  Dynamics<Dim> dynamics({body}, otm<Dim>({.reconnection_strain = 0.0}));
  hold(dynamics, body);
  const double end = 1.0;
  dynamics.run(end);
  const double bulk = E / (3.0 * (1.0 - 2.0 * nu));
  double damage = 0.0;
  constexpr int n = 20000;
  for (int k = 0; k < n; ++k) {
    const double t = end * (k + 0.5) / n, e = std::log1p(rate * t), flow = 2.0 / 3.0 * rate / (1.0 + rate * t);
    if (e > first_flow) damage += flow * end / n / law.at(bulk * e / yield, flow, 0.0);
  }
  ASSERT_GT(damage, 0.05);
  ASSERT_LT(damage, 0.9);
  const Vector found = dynamics.damage();
  EXPECT_NEAR(found.minCoeff(), damage, 0.02 * damage);
  EXPECT_NEAR(found.maxCoeff(), damage, 0.02 * damage);
}

TEST(Erosion, DamageSumsUpPlasticStrainOverThatAtFailure) {
  const FailureStrain johnson_cook(JohnsonCookFailure{.D = {0.2, 0.5, -0.4, 0.1, 0.0}, .reference = 1e-3});
  expect_damage<2>(johnson_cook);
  expect_damage<3>(johnson_cook);
  expect_damage<2>(FailureStrain::table({0.0, 3.0, 7.0}, {0.9, 0.3, 0.15}));
}

TEST(Erosion, AllPointsBreakAtThePlasticStrainOfTheTable) {
  const double rate = 0.1, failure = 0.05, time = std::expm1(1.5 * failure + first_flow) / rate;
  const DeformableBody<2> body = pulled<2>({.strain = FailureStrain::table({0.4}, {failure})}, rate, metal());
  Dynamics<2> dynamics({body}, otm<2>({.reconnection_strain = 0.0}));
  hold(dynamics, body);
  dynamics.run(0.99 * time);
  EXPECT_EQ(dynamics.count("eroded points"), 0);
  dynamics.run(1.02 * time);
  EXPECT_EQ(dynamics.count("eroded points"), dynamics.num_points());
}

TEST(Erosion, ShearDamagesByTheStrainOfTheTableWithoutMeanStress) {
  DeformableBody<2> body = pulled<2>({.strain = FailureStrain::table({-0.5, 0.0, 0.5}, {2.0, 0.4, 0.1})}, 0.0, metal());
  body.velocity.row(0) = 0.2 * body.nodes.row(1);
  Dynamics<2> dynamics({body}, otm<2>({.reconnection_strain = 0.0}));
  hold(dynamics, body);
  dynamics.run(1.0);
  const Vector strain = dynamics.history(0).row(6).transpose();
  ASSERT_GT(strain.minCoeff(), 0.05);
  EXPECT_LT((dynamics.damage() - strain / 0.4).cwiseAbs().maxCoeff(), 1e-10);
}

/// A bar of length 3 in uniaxial strain, free at its ends, whose first part of length 1 starts with the velocity
/// v cos^2(pi x / 2). The compressive wave that runs away from there comes back from the other end as tension: at the
/// distance d from that end, tau after the crest has arrived there by the speed c of sound, the axial stress is
/// rho c v / 2 sin(pi d) sin(pi tau) (d'Alembert 1747). It is largest at d = 1/2.
struct SpallingBar {
  static constexpr double nu = 0.3, size = 0.025, v = 1e-3;
  static double sound() { return std::sqrt((1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))); }
  /// Largest mean stress.
  static double strongest() { return 0.5 * sound() * v * (1.0 + nu) / (3.0 * (1.0 - nu)); }

  static Dynamics<2> with(double spall) {
    DeformableBody<2> body = deformable_body(triangulate(shapes::rectangle(0.0, 0.0, 3.0, 2.0 * size), {.size = size}),
                                             Hencky({.E = 1.0, .nu = nu}), 1.0);
    body.fracture.spall = spall;
    body.velocity.setZero(2, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a)
      if (const double x = body.nodes(0, a); x < 1.0)
        body.velocity(0, a) = v * std::pow(std::cos(0.5 * std::numbers::pi * x), 2);
    Dynamics<2> dynamics({body}, otm<2>());
    for (Index a = 0; a < dynamics.num_nodes(); ++a) dynamics.prescribe(a, 1, 0.0);
    return dynamics;
  }
};

TEST(Erosion, ABarSpallsWhereAndWhenTheReflectedWaveReachesItsStrength) {
  for (const double share : {0.5, 0.9}) {
    Dynamics<2> dynamics = SpallingBar::with(share * SpallingBar::strongest());
    const double tau = std::asin(share) / std::numbers::pi;
    while (dynamics.count("eroded points") == 0 && dynamics.time() < 4.0 / SpallingBar::sound()) dynamics.step();
    EXPECT_NEAR(dynamics.time() * SpallingBar::sound(), 3.0 + tau, 0.01) << share << ": a step";
    double sum = 0.0;
    for (Index p = 0; p < dynamics.num_points(); ++p)
      if (dynamics.is_eroded(p)) sum += dynamics.points()(0, p);
    EXPECT_NEAR(sum / static_cast<double>(dynamics.count("eroded points")), 2.5, 0.02) << share;
  }
}

TEST(Erosion, SpallNeedsATensionAsLargeAsTheStrength) {
  for (const double share : {0.97, 1.03}) {
    Dynamics<2> dynamics = SpallingBar::with(share * SpallingBar::strongest());
    dynamics.run(4.0 / SpallingBar::sound());
    EXPECT_EQ(dynamics.count("eroded points") > 0, share < 1.0) << share;
  }
}

TEST(Erosion, SpallGoesOnFromAStateBitwiseAndOnAnyNumberOfThreads) {
  const auto made = [] { return SpallingBar::with(0.5 * SpallingBar::strongest()); };
  auto dynamics = made(), other = made();
  dynamics.run(3.1 / SpallingBar::sound());
  other.restore(dynamics.state());
  const int threads = num_threads();
  dynamics.run(3.4 / SpallingBar::sound());
  set_num_threads(3);
  other.run(3.4 / SpallingBar::sound());
  set_num_threads(threads);
  ASSERT_GT(dynamics.count("eroded points"), 0);
  EXPECT_EQ(dynamics.nodes(), other.nodes());
  EXPECT_EQ(dynamics.damage(), other.damage());
}

TEST(Erosion, ASphereGoesThroughAPlateAndBalancesClose) {
  auto dynamics = bench::Perforation::bodies<2>(1e-3, 600.0, false, bench::Perforation::fracture());
  const auto end = bench::Perforation::run(dynamics);
  EXPECT_TRUE(end.through);
  EXPECT_GT(end.speed, 300.0);
  EXPECT_LT(end.speed, 580.0);
  EXPECT_GT(dynamics.count("eroded points"), 20);
  EXPECT_LT(std::abs(end.error), 0.02);
  EXPECT_LT(std::abs(end.mass_error), 1e-12);
  EXPECT_LT(std::abs(end.momentum_error), 1e-11);
}

/// A fragment of a few squashed cells slides along the sphere: contact takes energy, and gives back no more.
TEST(Erosion, FragmentsOfSquashedCellsGetNoEnergyFromContact) {
  auto dynamics = bench::Perforation::bodies<2>(0.5e-3, 700.0, true, bench::Perforation::fracture());
  const auto before = dynamics.balance();
  const auto end = bench::Perforation::run(dynamics);
  EXPECT_TRUE(end.through);
  EXPECT_GT(end.speed, 500.0);
  EXPECT_LT(end.speed, 650.0);
  EXPECT_LT(std::abs(end.error), 0.01);
  EXPECT_GE(dynamics.balance()["contact"], 0.0);
  EXPECT_LT(dynamics.balance()["contact"], 0.1 * before["kinetic"]);
}

TEST(Erosion, ASphereThatBreaksGoesThroughAPlateInSpace) {
  auto dynamics = bench::Perforation::bodies<3>(3e-3, 700.0, false, bench::Perforation::fracture());
  const auto end = bench::Perforation::run(dynamics, 12e-6);
  EXPECT_GT(end.speed, 500.0);
  EXPECT_LT(end.speed, 680.0);
  EXPECT_GT(dynamics.count("eroded points"), 50);
  EXPECT_LT(std::abs(end.error), 0.01);
  EXPECT_LT(std::abs(end.mass_error), 1e-12);
  EXPECT_LT(std::abs(end.momentum_error), 1e-11);
}

TEST(Erosion, GoesOnFromAStateBitwiseAndOnAnyNumberOfThreads) {
  const auto made = [] { return bench::Perforation::bodies<2>(1.25e-3, 600.0, true, bench::Perforation::fracture()); };
  auto dynamics = made(), other = made();
  dynamics.run(8e-6);
  ASSERT_GT(dynamics.count("eroded points"), 5);
  other.restore(dynamics.state());
  const int threads = num_threads();
  dynamics.run(14e-6);
  set_num_threads(3);
  other.run(14e-6);
  set_num_threads(threads);
  EXPECT_EQ(dynamics.nodes(), other.nodes());
  EXPECT_EQ(dynamics.velocities(), other.velocities());
  EXPECT_EQ(dynamics.damage(), other.damage());
  EXPECT_EQ(dynamics.count("eroded points"), other.count("eroded points"));
  EXPECT_EQ(dynamics.balance()["fracture"], other.balance()["fracture"]);
}

TEST(Erosion, ErodedPointsDoNotMultiply) {
  DeformableBody<2> body = pulled<2>({}, 0.4, soft());
  Dynamics<2> dynamics({body}, otm<2>({.insertion = 1.5}));
  const Index before = dynamics.num_points();
  dynamics.erode(0);
  hold(dynamics, body);
  dynamics.run(3.0);
  ASSERT_GT(dynamics.num_points(), before);
  Index eroded = 0;
  for (Index p = 0; p < dynamics.num_points(); ++p) eroded += dynamics.is_eroded(p) ? 1 : 0;
  EXPECT_EQ(eroded, 1);
  EXPECT_EQ(dynamics.damage()[0], 1.0);
}

TEST(Erosion, RefusesWhatMakesNoSense) {
  const auto make = [](const FractureCriteria& fracture) { Dynamics<2>({pulled<2>(fracture, 0.0, soft())}, otm<2>()); };
  EXPECT_THAT([&] { make({.toughness = -1.0}); }, ThrowsMessage<InputError>(HasSubstr("toughness")));
  EXPECT_THAT([&] { make({.toughness = 1.0, .neighbourhood = -1.0}); },
              ThrowsMessage<InputError>(HasSubstr("neighbourhood")));
  EXPECT_THAT([&] { make({.stretch = 0.5}); }, ThrowsMessage<InputError>(HasSubstr("stretch")));
  EXPECT_THAT([&] { make({.strain = JohnsonCookFailure{}}); }, ThrowsMessage<InputError>(HasSubstr("plastic strain")));
  EXPECT_THAT([&] { make({.spall = -1.0}); }, ThrowsMessage<InputError>(HasSubstr("spall strength -1")));
  EXPECT_THAT([] { FailureStrain(JohnsonCookFailure{.reference = 0.0}); },
              ThrowsMessage<InputError>(HasSubstr("reference rate of the plastic strain at failure = 0")));
  EXPECT_THAT(
      [] {
        FailureStrain::table({0.0, 0.0}, {1.0, 1.0});
      },
      ThrowsMessage<InputError>(HasSubstr("triaxiality 0 of a table after 0")));
  EXPECT_THAT(
      [] {
        FailureStrain::table({0.0, 1.0}, {1.0, -1.0});
      },
      ThrowsMessage<InputError>(HasSubstr("plastic strain at failure = -1")));
  Dynamics<2> dynamics({pulled<2>({}, 0.0, soft())}, otm<2>());
  EXPECT_THAT([&] { dynamics.erode(-1); }, ThrowsMessage<InputError>(HasSubstr("eroded")));
}

}  // namespace
}  // namespace efree
