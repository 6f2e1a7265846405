// SPDX-License-Identifier: GPL-3.0-or-later
/// Riemann's problem of a perfect gas: its exact solution, and the same by explicit dynamics, for tests and benchmarks.
#pragma once

#include "efree/core/error.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/materials/equation_of_state.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

namespace efree::bench {

/// A perfect gas on both sides of x = 0, where nothing parts them any more from time 0 on.
struct RiemannProblem {
  struct Gas {
    double density, velocity, pressure;
  };
  Gas left, right;
  double gamma = 1.4;
  double until;  ///< time

  static RiemannProblem sod() { return {{1.0, 0.0, 1.0}, {0.125, 0.0, 0.1}, 1.4, 0.2}; }
  static RiemannProblem lax() { return {{0.445, 0.698, 3.528}, {0.5, 0.0, 0.571}, 1.4, 0.14}; }
  /// Two streams that meet: shocks both ways.
  static RiemannProblem collision() { return {{1.0, 1.0, 1.0}, {1.0, -1.0, 1.0}, 1.4, 0.2}; }

  double sound(const Gas& gas) const { return std::sqrt(gamma * gas.pressure / gas.density); }

  struct Middle {
    double pressure, velocity;
  };
  /// Exact, at x = slope time (Toro 2009, section 4): waves are shocks where the pressure rises, else fans.
  Gas at(double slope) const { return at(slope, middle()); }
  Gas at(double slope, const Middle& between) const {
    const auto [p, u] = between;
    const bool on_left = slope < u;
    const Gas& side = on_left ? left : right;
    const double sign = on_left ? -1.0 : 1.0;  // along which the wave runs
    const double c = sound(side), ratio = p / side.pressure, weak = (gamma - 1.0) / (gamma + 1.0);
    const double along = sign * (slope - side.velocity);  // as the gas ahead sees it
    if (ratio > 1.0) {
      const double speed = c * std::sqrt((gamma + 1.0) / (2.0 * gamma) * ratio + (gamma - 1.0) / (2.0 * gamma));
      return along > speed ? side : Gas{side.density * (ratio + weak) / (weak * ratio + 1.0), u, p};
    }
    if (along > c) return side;
    const double behind = c * std::pow(ratio, (gamma - 1.0) / (2.0 * gamma));
    if (along < sign * (u - side.velocity) + behind) return {side.density * std::pow(ratio, 1.0 / gamma), u, p};
    const double local = 2.0 / (gamma + 1.0) * c + weak * along;  // the speed of sound inside of the fan
    return {side.density * std::pow(local / c, 2.0 / (gamma - 1.0)), slope - sign * local,
            side.pressure * std::pow(local / c, 2.0 * gamma / (gamma - 1.0))};
  }

  /// Between the waves, by bisection of the pressure: both sides get the same velocity there.
  Middle middle() const {
    // What a wave to the pressure p takes of the velocity.
    const auto jump = [&](const Gas& side, double p) {
      const double a = 2.0 / ((gamma + 1.0) * side.density), b = (gamma - 1.0) / (gamma + 1.0) * side.pressure;
      if (p > side.pressure) return (p - side.pressure) * std::sqrt(a / (p + b));
      return 2.0 * sound(side) / (gamma - 1.0) * (std::pow(p / side.pressure, (gamma - 1.0) / (2.0 * gamma)) - 1.0);
    };
    double low = 0.0, high = 1.0;
    const auto apart = [&](double p) { return jump(left, p) + jump(right, p) + right.velocity - left.velocity; };
    require(apart(0.0) < 0.0, "the gases part: there is a vacuum between them");
    while (apart(high) < 0.0) high *= 2.0;
    for (int k = 0; k < 200 && high - low > 1e-16 * high; ++k)
      (apart(0.5 * (low + high)) < 0.0 ? low : high) = 0.5 * (low + high);
    const double p = 0.5 * (low + high);
    return {p, 0.5 * (left.velocity + right.velocity + jump(right, p) - jump(left, p))};
  }
};

/// From -1/2 to 1/2: a strip in the plane, one cell high, with nodes in two rows and a material point in the middle of
/// every cell. Nodes move along x only, the ends with the gas that is there.
struct ShockTube {
  RiemannProblem problem;
  Index cells;
  Dynamics<2> dynamics;

  /// As few reconnections as possible, and shape functions that are not too smooth: with frequent reconnection under
  /// pressure nodes clump (docs/evidence.md).
  static OtmOptions scheme_options() {
    OtmOptions options;
    options.lme.gamma = 4.0;
    options.reconnection_strain = 0.5;
    options.merging = 0.0;  // points are counted
    return options;
  }
  /// Artificial viscosity as it is usual after von Neumann and Richtmyer, and Landshoff.
  static DynamicsOptions dynamics_options() { return {.shock = {.linear = 0.5, .quadratic = 2.0}}; }

  /// With `elements` shape functions are bilinear on the cells and stay: a Lagrangian finite element (or difference)
  /// method, which takes no options from `scheme`.
  ShockTube(const RiemannProblem& riemann, Index num_cells, bool elements = false,
            const OtmOptions& scheme = scheme_options(), const DynamicsOptions& options = dynamics_options())
      : problem(riemann),
        cells(num_cells),
        dynamics({body(riemann, num_cells, elements)}, elements ? total_lagrangian<2>() : otm<2>(scheme), options) {
    for (Index k = 0; k <= cells; ++k)
      for (const Index a : {k, k + cells + 1}) dynamics.prescribe(a, 1, 0.0);
    for (const Index a : {Index(0), cells + 1}) {
      dynamics.prescribe(a, 0, problem.left.velocity);
      dynamics.prescribe(a + cells, 0, problem.right.velocity);
    }
  }
  /// Cells of a strip from -1/2 to 1/2, of density 1 and at rest.
  static DeformableBody<2> strip(Index cells, SharedMaterial material) {
    const double h = 1.0 / cells;
    DeformableBody<2> result{.nodes = Points<2>(2, 2 * (cells + 1)),
                             .velocity = Points<2>::Zero(2, 2 * (cells + 1)),
                             .points = Points<2>(2, cells),
                             .volumes = Vector::Constant(cells, h * h),
                             .patches = {},
                             .material = std::move(material),
                             .densities = Vector::Ones(cells)};
    for (Index k = 0; k <= cells; ++k) {
      result.nodes.col(k) << k * h - 0.5, 0.0;
      result.nodes.col(k + cells + 1) << k * h - 0.5, h;
    }
    for (Index p = 0; p < cells; ++p) result.points.col(p) << (p + 0.5) * h - 0.5, 0.5 * h;
    return result;
  }
  static DeformableBody<2> body(const RiemannProblem& problem, Index cells, bool elements) {
    const double h = 1.0 / cells;
    const auto pressure = [=](const Vec<3>& X) { return X[0] < 0.0 ? problem.left.pressure : problem.right.pressure; };
    DeformableBody<2> result =
        strip(cells, Fluid({.state = EquationOfState::ideal_gas(problem.gamma), .pressure = pressure}));
    for (Index k = 0; k <= cells; ++k)
      for (const Index a : {k, k + cells + 1})
        // The node between the gases has what both bring in the mean.
        result.velocity(0, a) = 2 * k < cells   ? problem.left.velocity
                                : 2 * k > cells ? problem.right.velocity
                                                : 0.5 * (problem.left.velocity + problem.right.velocity);
    for (Index p = 0; p < cells; ++p)
      result.densities[p] = 2 * p < cells ? problem.left.density : problem.right.density;
    if (!elements) return result;
    std::vector<Offset> offsets{0};
    std::vector<Index> nodes;
    std::vector<Vec<2>> gradients;
    for (Index k = 0; k < cells; ++k) {
      for (const Index a : {k, k + 1, k + cells + 1, k + cells + 2}) nodes.push_back(a);
      for (const double y : {-0.5, 0.5})
        for (const double x : {-0.5, 0.5}) gradients.push_back(Vec<2>(x, y) / h);
      offsets.push_back(4 * (k + 1));
    }
    result.shape = ShapeTable<2>(2 * (cells + 1), std::move(offsets), std::move(nodes),
                                 std::vector<double>(4 * static_cast<std::size_t>(cells), 0.25), std::move(gradients));
    return result;
  }

  struct Sample {
    double x, density, velocity, pressure, energy;  ///< energy: internal, by mass
  };
  /// At the material points; velocities are half a step old.
  std::vector<Sample> samples() const {
    const Points<2> x = dynamics.points(), v = dynamics.velocities();
    const Points<2>& nodes = dynamics.nodes();
    const Tensors F = dynamics.deformation(), stress = dynamics.cauchy_stress();
    std::vector<Sample> result(cells);
    Index k = 1;
    for (Index p = 0; p < cells; ++p) {
      const double density = 2 * p < cells ? problem.left.density : problem.right.density;
      const double J = Eigen::Map<const Mat<3>>(F.col(p).data()).determinant(), pressure = -stress(0, p);
      while (k < cells && nodes(0, k) < x(0, p)) ++k;
      const double s = (x(0, p) - nodes(0, k - 1)) / (nodes(0, k) - nodes(0, k - 1));
      result[p] = {x(0, p), density / J, (1.0 - s) * v(0, k - 1) + s * v(0, k), pressure,
                   pressure * J / (density * (problem.gamma - 1.0))};
    }
    return result;
  }

  struct Errors {
    double density, velocity, pressure;  ///< density and pressure in L1, velocity in L2
  };
  /// Of densities and pressures that are constant around each point, to half way to the next one, and velocities that
  /// are linear between nodes, by the midpoint rule on a twentieth of each interval.
  Errors errors(double time_of_velocity) const {
    const Points<2>&x = dynamics.nodes(), v = dynamics.velocities();
    const std::vector<Sample> found = samples();
    const auto middle = problem.middle();
    constexpr int parts = 20;
    Errors result{0.0, 0.0, 0.0};
    for (Index p = 0; p < cells; ++p) {
      const double from = p == 0 ? x(0, 0) : 0.5 * (found[p - 1].x + found[p].x);
      const double to = p + 1 == cells ? x(0, cells) : 0.5 * (found[p].x + found[p + 1].x);
      for (int i = 0; i < parts; ++i) {
        const auto exact = problem.at((from + (i + 0.5) / parts * (to - from)) / dynamics.time(), middle);
        result.density += std::abs((to - from) / parts * (found[p].density - exact.density));
        result.pressure += std::abs((to - from) / parts * (found[p].pressure - exact.pressure));
      }
    }
    for (Index k = 0; k < cells; ++k)
      for (int i = 0; i < parts; ++i) {
        const double s = (i + 0.5) / parts, width = (x(0, k + 1) - x(0, k)) / parts;
        const double off = (1.0 - s) * v(0, k) + s * v(0, k + 1) -
                           problem.at(((1.0 - s) * x(0, k) + s * x(0, k + 1)) / time_of_velocity, middle).velocity;
        result.velocity += std::abs(width) * off * off;
      }
    result.velocity = std::sqrt(result.velocity);
    return result;
  }

  /// To the problem's end, in which no wave reaches the ends of the tube. Returns the errors there.
  Errors run() {
    double last = 0.0;
    while (dynamics.time() < problem.until * (1.0 - 1e-12)) last = dynamics.step(problem.until - dynamics.time());
    return errors(dynamics.time() - 0.5 * last);
  }
};

}  // namespace efree::bench
