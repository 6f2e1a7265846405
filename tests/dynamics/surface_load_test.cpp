// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/surface_load.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace efree {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr double E = 1.0, density = 1.0;  // waves in bars without Poisson's ratio travel 1 in a time of 1

SharedMaterial rubber(double nu) {
  return NeoHookean({.E = E, .nu = nu});
}

/// The facets of a named side, with the nodes for vertices.
template <int Dim> SurfacePart<Dim> side_of(const FineMesh<Dim>& mesh, const std::string& name) {
  SurfacePart<Dim> part{.facets = mesh.facets()(Eigen::all, mesh.group(name)), .functions = {}};
  part.functions.resize(mesh.num_vertices(), mesh.num_vertices());
  part.functions.setIdentity();
  return part;
}

/// A bar along x, 2 long and 0.2 high, held at its left end.
struct Bar {
  static constexpr double pull = 1e-3;
  FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 2.0, 0.2), {.size = 0.05});
  Dynamics<2> dynamics{{deformable_body(mesh, rubber(0.0), density)}, otm<2>()};
  Bar() {
    dynamics.prescribe([](const Vec<2>& x) { return x[0] < 1e-9; }, 0, 0.0);
  }
  double end() const {
    double largest = 0.0;
    for (Index a = 0; a < dynamics.num_nodes(); ++a) largest = std::max(largest, dynamics.nodes()(0, a));
    return largest;
  }
};

TEST(SurfaceLoad, ASuddenTractionStretchesABarByTwiceItsStaticStretch) {
  Bar bar;
  bar.dynamics.add_interaction(surface_load<2>(
      {.part = side_of(bar.mesh, "right"), .traction = [](const Vec<2>&, double) { return Vec<2>(Bar::pull, 0.0); }}));
  double largest = 0.0;
  while (bar.dynamics.time() < 5.0) {
    bar.dynamics.step();
    largest = std::max(largest, bar.end() - 2.0);
  }
  EXPECT_NEAR(largest, 2.0 * Bar::pull / E * 2.0, 0.02 * 4.0 * Bar::pull);  // u = 2 p L / E at 2 L / c
  const auto balance = bar.dynamics.balance();
  EXPECT_GT(balance["loads"], 0.0);
  EXPECT_LT(std::abs(bar.dynamics.energy().largest_error()), 2e-3);
}

TEST(SurfaceLoad, ADamperOfTheImpedanceSwallowsAWave) {
  Bar bar;
  // A pull for a time of 0.5 sends a wave to the left, which comes back after 4.
  bar.dynamics.add_interaction(
      surface_load<2>({.part = side_of(bar.mesh, "right"), .traction = [](const Vec<2>&, double t) {
                         return Vec<2>(t < 1.0 ? Bar::pull * std::pow(std::sin(std::numbers::pi * t), 2) : 0.0, 0.0);
                       }}));
  bar.dynamics.run(1.5);
  const double sent = bar.dynamics.balance()["kinetic"] + bar.dynamics.balance()["stored"];
  bar.dynamics.add_interaction(
      surface_load<2>({.part = side_of(bar.mesh, "right"), .damping = Vec<2>(std::sqrt(E * density), 0.0)}));
  bar.dynamics.run(6.0);
  const auto balance = bar.dynamics.balance();
  EXPECT_LT(balance["kinetic"] + balance["stored"], 0.01 * sent);
  EXPECT_NEAR(balance["damping"], sent, 0.02 * sent);
}

TEST(SurfaceLoad, ABlockSwingsOnSpringsAtTheirFrequency) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.2});
  DeformableBody<2> body = deformable_body(mesh, rubber(0.3), density);
  body.velocity = Vec<2>(0.0, 0.01).replicate(1, body.nodes.cols());
  Dynamics<2> dynamics({body}, otm<2>());
  constexpr double k = 1e-2;
  dynamics.add_interaction(surface_load<2>({.part = side_of(mesh, "bottom"), .stiffness = Vec<2>::Constant(k)}));
  const double omega = std::sqrt(k);  // of a mass of 1 on a side of 1
  const auto height = [&] { return (dynamics.nodes().row(1) * dynamics.masses())(0); };
  const double start = height();
  dynamics.run(0.5 * std::numbers::pi / omega);
  EXPECT_NEAR(height() - start, 0.01 / omega, 0.01 * 0.01 / omega);
  EXPECT_NEAR(dynamics.balance()["springs"], 0.5 * 1e-4, 0.02 * 0.5e-4);
  dynamics.run(std::numbers::pi / omega);
  EXPECT_NEAR(height() - start, 0.0, 0.02 * 0.01 / omega);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 2e-3);
}

TEST(SurfaceLoad, AThickRingUnderPressureComesToRestAtLamesSolution) {
  constexpr double p = 1e-3, a = 0.5, b = 1.0, nu = 0.3;
  const auto mesh = triangulate(shapes::annulus(a, b, 0.05), {.size = 0.05});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(nu), density)}, otm<2>());
  dynamics.add_interaction(surface_load<2>({.part = side_of(mesh, "inner"), .pressure = [](const Vec<2>&, double t) {
                                              return p * std::min(1.0, t / 5.0);
                                            }}));
  dynamics.add_interaction(surface_load<2>({.part = side_of(mesh, "outer"), .damping = Vec<2>::Constant(0.3)}));
  const Points<2> start = dynamics.nodes();
  dynamics.run(20.0);
  // u(a) in plane strain (Timoshenko & Goodier 1970, section 28).
  const double exact = p * a * (1.0 + nu) / E * ((1.0 - 2.0 * nu) * a * a + b * b) / (b * b - a * a);
  double sum = 0.0, count = 0.0;
  for (Index k = 0; k < start.cols(); ++k)
    if (std::abs(start.col(k).norm() - a) < 1e-9) {
      sum += (dynamics.nodes().col(k) - start.col(k)).dot(start.col(k)) / a;
      count += 1.0;
    }
  EXPECT_NEAR(sum / count, exact, 0.01 * exact);
  EXPECT_LT(dynamics.balance()["kinetic"], 1e-3 * dynamics.balance()["stored"]);
  EXPECT_LT(dynamics.balance().momentum.norm(), 1e-9);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 2e-3);
}

TEST(SurfaceLoad, APressureFollowsASideThatTurnsUnlessItIsHeld) {
  // A block that is turned by a quarter while it is loaded: where its force then points to.
  const auto mesh = triangulate(shapes::rectangle(-0.5, -0.5, 0.5, 0.5), {.size = 0.25});
  for (const bool follows : {true, false}) {
    DeformableBody<2> body = deformable_body(mesh, rubber(0.3), density);
    constexpr double turn = 0.01;
    body.velocity.resize(2, body.nodes.cols());
    for (Index a = 0; a < body.nodes.cols(); ++a)
      body.velocity.col(a) = turn * Vec<2>(-body.nodes(1, a), body.nodes(0, a));
    Dynamics<2> dynamics({body}, otm<2>());
    dynamics.add_interaction(surface_load<2>(
        {.part = side_of(mesh, "right"), .pressure = [](const Vec<2>&, double) { return 1e-9; }, .follows = follows}));
    const double quarter = 0.5 * std::numbers::pi / turn;
    dynamics.run(quarter);
    const Vec<2> momentum = dynamics.balance().momentum;
    // -p int n dt, with n = (cos turn t, sin turn t) or (1, 0).
    const Vec<2> exact = -1e-9 * (follows ? Vec<2>(1.0 / turn, 1.0 / turn) : Vec<2>(quarter, 0.0));
    EXPECT_LT((momentum - exact).norm(), 0.01 * exact.norm()) << follows;
  }
}

TEST(SurfaceLoad, LoadsThatMakeNoSenseAreRefused) {
  EXPECT_THAT([] { surface_load<2>({}); }, ThrowsMessage<InputError>(HasSubstr("expected a traction")));
  EXPECT_THAT(
      [] {
        surface_load<2>({.stiffness = {-1.0, 0.0}});
      },
      ThrowsMessage<InputError>(HasSubstr("of 0 or more")));
  Bar bar;
  EXPECT_THAT(
      [&] {
        bar.dynamics.add_interaction(surface_load<2>({.stiffness = {1.0, 0.0}}));
      },
      ThrowsMessage<InputError>(HasSubstr("expected facets of vertices")));
}

TEST(Gravity, FollowsALawOfTheTime) {
  const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = 0.5});
  Dynamics<2> dynamics({deformable_body(mesh, rubber(0.3), density)}, otm<2>());
  dynamics.set_gravity_law([](double t) { return Vec<2>(0.0, -2.0 * t); });
  for (int k = 1; k <= 100; ++k) dynamics.run(0.01 * k);
  const auto balance = dynamics.balance();
  const double speed = -dynamics.velocities().row(1).mean(), dt = dynamics.world().last_step;
  EXPECT_NEAR(speed, (1.0 - 0.5 * dt) * (1.0 - 0.5 * dt), 0.3 * dt * dt);  // half a step ago
  EXPECT_NEAR(balance["gravity"], balance["kinetic"], 0.01 * balance["kinetic"]);
}

}  // namespace
}  // namespace efree
