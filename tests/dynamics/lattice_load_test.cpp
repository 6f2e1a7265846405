// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on parts of the boundary by the material point method and smoothed particles: closed forms.
#include "efree/bench/mpm_scenes.hpp"
#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/mpm/mpm.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/dynamics/surface_load.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/geometry/meshing/solid_shapes.hpp"
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

enum class On { points, splines, mesh, particles, fixed_particles };
constexpr On all_lattices[] = {On::points, On::splines, On::mesh, On::particles, On::fixed_particles};

/// A body of a mesh on a lattice, Young's modulus and density 1, and parts of its surface.
template <int Dim> struct OnLattice {
  OnLattice(FineMesh<Dim> of, On on, double size, double nu = 0.0, MpmOptions grid_options = {})
      : mesh(std::move(of)), on(on), grid(grid_options) {
    grid.cell = particles.spacing = size;
    for (int i = 0; i < Dim; ++i)
      grid.origin[static_cast<std::size_t>(i)] = particles.origin[static_cast<std::size_t>(i)] =
          mesh.vertices().row(i).minCoeff();
    particles.viscosity = {0.0, 0.0};
    particles.corrected = true;
    const SharedMaterial material = NeoHookean({.E = 1.0, .nu = nu});
    body = is_sph() ? particles_on_lattice<Dim>(mesh, on == On::particles ? SphFrame::updated : SphFrame::total,
                                                particles, material, 1.0)
                    : body_on_lattice<Dim>(mesh, frame(), grid, 2, material, 1.0);
    body.patches.clear();
  }
  bool is_sph() const { return on == On::particles || on == On::fixed_particles; }
  MpmFrame frame() const {
    return on == On::points ? MpmFrame::updated : on == On::splines ? MpmFrame::total : MpmFrame::mesh;
  }
  Dynamics<Dim> dynamics(const DynamicsOptions& options = {}) const {
    if (on == On::points || on == On::mesh) return {{body}, mpm<Dim>(grid), options};
    if (on == On::particles) return {{body}, sph<Dim>(particles), options};
    return {{body}, total_lagrangian<Dim>(), options};
  }
  SurfacePart<Dim> part(const std::string& name) const {
    const std::vector<Index>& facets = mesh.group(name);
    return is_sph() ? surface_of_particles(mesh, facets, particles, body)
                    : surface_on_lattice(mesh, facets, frame(), grid, body);
  }

  FineMesh<Dim> mesh;
  On on;
  MpmOptions grid;
  SphOptions particles;
  DeformableBody<Dim> body;
};

/// A bar along x from 0 to `length`.
OnLattice<2> bar_on(On on, double length, double height, double size, MpmOptions grid = {}) {
  const double edge = on == On::mesh ? 0.5 * size : size;
  return {triangulate(shapes::rectangle(0.0, 0.0, length, height), {.size = edge}), on, size, 0.0, grid};
}

/// Sum of the forces on the nodes, and of their moments about the origin.
template <int Dim> std::pair<Vec<Dim>, Spin<Dim>> resultant(const Dynamics<Dim>& dynamics) {
  std::pair<Vec<Dim>, Spin<Dim>> sum{Vec<Dim>::Zero(), Spin<Dim>::Zero()};
  const Nodes<Dim>& nodes = dynamics.world().nodes;
  for (Index a = 0; a < nodes.size(); ++a) {
    sum.first += nodes.force.col(a);
    sum.second += moment_about_origin<Dim>(nodes.x.col(a), nodes.force.col(a));
  }
  return sum;
}

TEST(LatticeLoads, ResultantsAreExactOnSidesAndCurves) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    // A linear traction on a side of length 0.7: force and moment by hand.
    const OnLattice<2> bar = bar_on(on, 1.0, 0.7, 0.1);
    Dynamics<2> pulled = bar.dynamics();
    pulled.add_interaction(surface_load<2>(
        {.part = bar.part("right"), .traction = [](const Vec<2>& X, double) { return Vec<2>(2.0, 3.0 * X[1]); }}));
    const auto [force, moment] = resultant(pulled);
    EXPECT_NEAR(force[0], 1.4, 1e-12);
    EXPECT_NEAR(force[1], 1.5 * 0.49, 1e-12);
    const double exact = 1.5 * 0.49 - 0.49;  // int x t_y - y t_x
    EXPECT_NEAR(moment[0], exact, bar.is_sph() ? 0.06 : 1e-12);
    // A pressure inside a closed polygon has no resultant; on a quarter it is that of the chord.
    const OnLattice<2> ring(triangulate(shapes::annulus(0.5, 1.0, 0.05), {.size = 0.06}), on, 0.1);
    Dynamics<2> blown = ring.dynamics();
    blown.add_interaction(
        surface_load<2>({.part = ring.part("inner"), .pressure = [](const Vec<2>&, double) { return 1.0; }}));
    EXPECT_LT(resultant(blown).first.norm(), 1e-12);
    EXPECT_NEAR(blown.world().nodes.force.colwise().norm().sum(), std::numbers::pi, 0.2);
  }
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<3> box(FineMesh<3>(solids::box({1.0, 0.8, 0.6}, 0.2)), on, 0.1);
    Dynamics<3> pulled = box.dynamics();
    pulled.add_interaction(surface_load<3>(
        {.part = box.part("top"), .traction = [](const Vec<3>&, double) { return Vec<3>(1.0, 2.0, 3.0); }}));
    const auto [force, moment] = resultant(pulled);
    EXPECT_LT((force - 0.8 * Vec<3>(1.0, 2.0, 3.0)).norm(), 1e-12);
    const Vec<3> exact = Vec<3>(0.5, 0.4, 0.6).cross(0.8 * Vec<3>(1.0, 2.0, 3.0));
    EXPECT_LT((moment - exact).norm(), box.is_sph() ? 0.1 : 1e-12);
  }
}

TEST(LatticeLoads, AFreeBarTakesUpTheImpulseOfATraction) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> bar = bar_on(on, 1.0, 0.5, 0.1);
    Dynamics<2> dynamics = bar.dynamics();
    dynamics.add_interaction(surface_load<2>(
        {.part = bar.part("right"), .traction = [](const Vec<2>&, double) { return Vec<2>(0.02, 0.01); }}));
    double dt = 0.0;
    for (int k = 0; k < 200; ++k) dt = dynamics.step();
    const double t = dynamics.time() - 0.5 * dt;
    EXPECT_GT(t, 2.0);
    EXPECT_LT((dynamics.balance().momentum - 0.5 * t * Vec<2>(0.02, 0.01)).norm(), 1e-4 * t);
    EXPECT_GT(dynamics.balance()["loads"], 1e-4);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  }
}

TEST(LatticeLoads, ALoadStaysOnABodyThatItMovesFarThroughTheGrid) {
  for (const On on : {On::points, On::mesh}) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> bar = bar_on(on, 1.0, 0.5, 0.1);
    Dynamics<2> dynamics = bar.dynamics();
    dynamics.add_interaction(surface_load<2>(
        {.part = bar.part("right"), .traction = [](const Vec<2>&, double) { return Vec<2>(0.02, 0.0); }}));
    const Points<2> start = dynamics.points();
    dynamics.run(20.0);
    const auto balance = dynamics.balance();
    EXPECT_GT((dynamics.points() - start).row(0).minCoeff(), 3.9);  // cells of 0.1
    EXPECT_NEAR(balance.momentum[0], 0.5 * 0.02 * 20.0, 1e-3);      // of up to half a step ago
    EXPECT_NEAR(balance["kinetic"], 0.04, 1e-3 * 0.04);
    EXPECT_NEAR(balance["loads"], 0.04, 0.02 * 0.04);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  }
}

/// A bar of length 2, held at its left end, under a traction of 1e-3 from time 0 on: errors of the displacement along
/// it over 2e-3, at most, at 2 L / c, where it is twice that at rest, and at 4 L / c, where it is none.
std::pair<double, double> errors_of_sudden_traction(On on, double size) {
  constexpr double pull = 1e-3, length = 2.0;
  const OnLattice<2> bar = bar_on(on, length, 0.4, size);
  Dynamics<2> dynamics = bar.dynamics();
  const double reach = bar.is_sph() ? 0.6 * size : 1e-9;
  dynamics.prescribe([reach](const Vec<2>& x) { return x[0] < reach; }, 0, 0.0);
  dynamics.add_interaction(surface_load<2>(
      {.part = bar.part("right"), .traction = [=](const Vec<2>&, double) { return Vec<2>(pull, 0.0); }}));
  const Points<2> start = dynamics.points();
  const double held = bar.is_sph() ? 0.5 * size : 0.0;
  const auto error = [&](double stretch) {
    const Points<2> moved = dynamics.points() - start;
    double largest = 0.0;
    for (Index p = 0; p < start.cols(); ++p)
      largest = std::max(largest, std::abs(moved(0, p) - stretch * (start(0, p) - held)));
    return largest / (pull * length);
  };
  dynamics.run(2.0 * (length - held));
  const double stretched = error(2.0 * pull);
  dynamics.run(4.0 * (length - held));
  const double back = error(0.0);
  EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  return {stretched, back};
}

TEST(LatticeLoads, ASuddenTractionStretchesABarByTwiceItsStaticStretch) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const auto [stretched, back] = errors_of_sudden_traction(on, 0.1);
    const auto [finer, finer_back] = errors_of_sudden_traction(on, 0.05);
    // Of the largest displacement half as much.
    EXPECT_LT(finer, (on == On::particles || on == On::fixed_particles ? 0.08 : 0.038));
    EXPECT_LT(finer_back, on == On::particles || on == On::fixed_particles ? 0.16 : 0.08);
    EXPECT_GT(stretched / finer, 1.25);
    EXPECT_LT(stretched / finer, 3.0);
  }
}

TEST(LatticeLoads, ABarAtRestUnderATractionHasItsStress) {
  constexpr double pull = 1e-3, size = 0.1;
  for (const On on : all_lattices)
    for (const double length : {2.0, 2.04}) {  // ends at a node, and between them
      SCOPED_TRACE(static_cast<int>(on));
      const OnLattice<2> bar = bar_on(on, length, 0.5, size);
      Dynamics<2> dynamics = bar.dynamics({.rest_from = 0.0});
      const double reach = bar.is_sph() ? 0.6 * size : 1e-9;
      dynamics.prescribe([reach](const Vec<2>& x) { return x[0] < reach; }, 0, 0.0);
      dynamics.add_interaction(surface_load<2>(
          {.part = bar.part("right"), .traction = [=](const Vec<2>&, double) { return Vec<2>(pull, 0.0); }}));
      const Points<2> start = dynamics.points();
      while (dynamics.time() < 400.0 && !(dynamics.residual() < 1e-4)) dynamics.run(dynamics.time() + 1.0);
      EXPECT_LT(dynamics.residual(), 1e-4);
      EXPECT_LT(dynamics.time(), 399.0);
      const Tensors stress = dynamics.cauchy_stress();
      double inside = 0.0, largest = 0.0;
      for (Index p = 0; p < start.cols(); ++p) {
        const double error = std::abs(stress(0, p) / pull - 1.0);
        largest = std::max(largest, error);
        if (start(0, p) > 0.4 && start(0, p) < length - 0.4) inside = std::max(inside, error);
      }
      EXPECT_LT(inside, bar.is_sph() ? 0.04 : 0.02);
      EXPECT_LT(largest, on == On::mesh ? 0.4 : 1.0);
    }
}

TEST(LatticeLoads, AThickRingUnderPressureComesToRestAtLamesSolution) {
  constexpr double p = 1e-3, a = 0.5, b = 1.0, nu = 0.3;
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> ring(triangulate(shapes::annulus(a, b, 0.05), {.size = on == On::mesh ? 0.03 : 0.06}), on, 0.05,
                            nu);
    Dynamics<2> dynamics = ring.dynamics();
    dynamics.add_interaction(surface_load<2>(
        {.part = ring.part("inner"), .pressure = [](const Vec<2>&, double t) { return p * std::min(1.0, t / 5.0); }}));
    dynamics.add_interaction(surface_load<2>({.part = ring.part("outer"), .damping = Vec<2>::Constant(0.3)}));
    const Points<2> start = dynamics.points();
    dynamics.run(20.0);
    // u in plane strain (Timoshenko & Goodier 1970, section 28).
    const auto exact = [&](double r) {
      return p * (1.0 + nu) * a * a / (b * b - a * a) * ((1.0 - 2.0 * nu) * r + b * b / r);
    };
    const Points<2> moved = dynamics.points() - start;
    double sum = 0.0, largest = 0.0;
    for (Index k = 0; k < start.cols(); ++k) {
      const double r = start.col(k).norm(), u = moved.col(k).dot(start.col(k)) / r;
      sum += u / exact(r) / static_cast<double>(start.cols());
      largest = std::max(largest, (moved.col(k) - exact(r) / r * start.col(k)).norm() / exact(a));
    }
    EXPECT_NEAR(sum, 1.0, 0.02);
    EXPECT_LT(largest, on == On::particles || on == On::fixed_particles ? 0.15 : 0.05);
    EXPECT_LT(dynamics.balance()["kinetic"], 1e-3 * dynamics.balance()["stored"]);
    EXPECT_LT(dynamics.balance().momentum.norm(), 1e-4 * p);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  }
}

TEST(LatticeLoads, ABlockSwingsOnSpringsAtTheirFrequency) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> block = bar_on(on, 1.0, 1.0, 0.1);
    OnLattice<2> moving = block;
    moving.body.velocity = Vec<2>(0.0, 0.01).replicate(1, bench::moving_of(moving.body).cols());
    Dynamics<2> dynamics = moving.dynamics();
    constexpr double k = 1e-2;
    dynamics.add_interaction(surface_load<2>({.part = block.part("bottom"), .stiffness = Vec<2>::Constant(k)}));
    const double omega = std::sqrt(k);  // of a mass of 1 on a side of 1
    const Points<2> start = dynamics.points();
    const auto way = [&] { return (dynamics.points() - start).row(1).mean(); };
    dynamics.run(0.5 * std::numbers::pi / omega);
    EXPECT_NEAR(way(), 0.01 / omega, 0.01 * 0.01 / omega);
    EXPECT_NEAR(dynamics.balance()["springs"], 0.5e-4, 0.03 * 0.5e-4);
    dynamics.run(std::numbers::pi / omega);
    EXPECT_NEAR(way(), 0.0, 0.03 * 0.01 / omega);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  }
}

TEST(LatticeLoads, StiffSpringsShortenTheStepAndStayStable) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> block = bar_on(on, 1.0, 0.5, 0.1);
    Dynamics<2> dynamics = block.dynamics();
    dynamics.step();
    const double before = dynamics.stable_step();
    dynamics.add_interaction(surface_load<2>({.part = block.part("left"), .stiffness = Vec<2>::Constant(1e3)}));
    dynamics.add_interaction(surface_load<2>(
        {.part = block.part("right"), .traction = [](const Vec<2>&, double) { return Vec<2>(1e-3, 0.0); }}));
    dynamics.step();
    EXPECT_LT(dynamics.stable_step(), 0.9 * before);
    dynamics.run(10.0);
    EXPECT_LT(dynamics.balance()["kinetic"] + dynamics.balance()["stored"], 1e-6);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.01);
  }
}

TEST(LatticeLoads, APressureFollowsASideThatTurnsUnlessItIsHeld) {
  for (const On on : all_lattices)
    for (const bool follows : {true, false}) {
      SCOPED_TRACE(static_cast<int>(on));
      SCOPED_TRACE(follows);
      OnLattice<2> block(triangulate(shapes::rectangle(-0.5, -0.5, 0.5, 0.5), {.size = 0.1}), on, 0.1, 0.3);
      constexpr double turn = 0.01;
      block.body.velocity =
          bench::velocity_by_place<2>(block.body, [=](const Vec<2>& x) { return Vec<2>(turn * Vec<2>(-x[1], x[0])); });
      Dynamics<2> dynamics = block.dynamics({.imbalance = 1.0});
      dynamics.add_interaction(surface_load<2>(
          {.part = block.part("right"), .pressure = [](const Vec<2>&, double) { return 1e-9; }, .follows = follows}));
      const double quarter = 0.5 * std::numbers::pi / turn;
      dynamics.run(quarter);
      const Vec<2> momentum = dynamics.balance().momentum;
      // -p int n dt, with n = (cos turn t, sin turn t) or (1, 0).
      const Vec<2> exact = -1e-9 * (follows ? Vec<2>(1.0 / turn, 1.0 / turn) : Vec<2>(quarter, 0.0));
      EXPECT_LT((momentum - exact).norm(), 0.02 * exact.norm());
    }
}

TEST(LatticeLoads, FacetsOfPointsThatBreakBearNothingAnyMore) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const OnLattice<2> bar = bar_on(on, 1.0, 0.5, 0.1);
    Dynamics<2> dynamics = bar.dynamics();
    dynamics.add_interaction(surface_load<2>(
        {.part = bar.part("right"), .traction = [](const Vec<2>&, double) { return Vec<2>(1e-3, 0.0); }}));
    EXPECT_NEAR(resultant(dynamics).first[0], 0.5e-3, 1e-15);
    const Points<2> x = dynamics.points();
    for (Index p = 0; p < x.cols(); ++p)
      if (x(0, p) > 0.85 && x(1, p) > 0.27) dynamics.erode(p);
    EXPECT_LT((dynamics.points() - x).norm(), 1e-12);
    EXPECT_NEAR(resultant(dynamics).first[0], 0.275e-3, 0.04e-3);
    dynamics.run(1.0);
    EXPECT_LT(std::abs(dynamics.energy().largest_error()), 0.02);
  }
}

TEST(LatticeLoads, ResultsAreBitwiseTheSameOnThreadsAndFromAState) {
  for (const On on : all_lattices) {
    SCOPED_TRACE(static_cast<int>(on));
    const auto made = [&] {
      const OnLattice<2> block = bar_on(on, 1.0, 0.5, 0.1);
      Dynamics<2> dynamics = block.dynamics();
      dynamics.add_interaction(
          surface_load<2>({.part = block.part("right"),
                           .traction = [](const Vec<2>&, double t) { return Vec<2>(0.01 * t, 0.0); },
                           .pressure = [](const Vec<2>& X, double) { return 0.01 * X[1]; }}));
      dynamics.add_interaction(surface_load<2>({.part = block.part("left"), .stiffness = Vec<2>(0.1, 0.0)}));
      dynamics.add_interaction(surface_load<2>({.part = block.part("top"), .damping = Vec<2>::Constant(0.1)}));
      return dynamics;
    };
    const auto ran = [&](int threads, bool breaks_off) {
      return test::run_in_two(threads, breaks_off, 1.0, 2.0, made);
    };
    const Dynamics<2> one = ran(1, false);
    for (const char* energy : {"loads", "springs", "damping"}) EXPECT_GT(one.balance()[energy], 0.0) << energy;
    EXPECT_LT(std::abs(one.energy().largest_error()), 0.01);
    for (const Dynamics<2>& other : {ran(2, false), ran(1, true)}) {
      EXPECT_TRUE(one.points() == other.points());
      EXPECT_TRUE(one.cauchy_stress() == other.cauchy_stress());
      for (const char* energy : {"loads", "springs", "damping"})
        EXPECT_EQ(one.balance()[energy], other.balance()[energy]);
      EXPECT_EQ(one.balance().total(), other.balance().total());
    }
  }
}

TEST(LatticeLoads, PartsOfOtherSchemesAreRefused) {
  const OnLattice<2> points = bar_on(On::points, 1.0, 0.5, 0.1), splines = bar_on(On::splines, 1.0, 0.5, 0.1);
  Dynamics<2> by_points = points.dynamics(), by_splines = splines.dynamics();
  EXPECT_THAT(
      [&] {
        by_splines.add_interaction(surface_load<2>({.part = points.part("left"), .stiffness = {1.0, 0.0}}));
      },
      ThrowsMessage<InputError>(HasSubstr("functions of the nodes")));
  EXPECT_THAT(
      [&] {
        by_points.add_interaction(surface_load<2>({.part = splines.part("left"), .stiffness = {1.0, 0.0}}));
      },
      ThrowsMessage<InputError>(HasSubstr("a load on a surface: expected")));
}

}  // namespace
}  // namespace efree
