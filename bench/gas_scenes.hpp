// SPDX-License-Identifier: GPL-3.0-or-later
/// Gases at rest and under shocks, and a jet of water, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/equation_of_state.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace efree::bench {

/// How a gas is computed.
struct GasOptions {
  OtmOptions scheme{};
  DynamicsOptions dynamics{.shock = {.linear = 0.5, .quadratic = 2.0}};
  bool patches = false;  ///< pressure patches
};

/// At material points.
struct GasSamples {
  Points<2> x;
  Vector density, pressure, volume;  ///< volume now
};
inline GasSamples gas_samples(const Dynamics<2>& dynamics, double density) {
  GasSamples result{.x = dynamics.points(), .density = {}, .pressure = {}, .volume = {}};
  const Tensors F = dynamics.deformation(), stress = dynamics.cauchy_stress();
  const Index n = dynamics.num_points();
  result.density.resize(n);
  result.pressure.resize(n);
  result.volume.resize(n);
  for (Index p = 0; p < n; ++p) {
    const double J = Eigen::Map<const Mat<3>>(F.col(p).data()).determinant();
    const auto [chunk, k] = dynamics.world().locate(p);
    result.density[p] = density / J;
    result.pressure[p] = -(stress(0, p) + stress(4, p) + stress(8, p)) / 3.0;
    result.volume[p] = J * chunk.matter.volume[k];
  }
  return result;
}

/// Mean and standard deviation by weights.
struct Spread {
  double sum = 0.0, mean = 0.0, squares = 0.0;
  void add(double value, double weight) {
    sum += weight;
    const double off = value - mean;
    mean += weight / sum * off;
    squares += weight * off * (value - mean);
  }
  double deviation() const { return sum > 0.0 ? std::sqrt(squares / sum) : 0.0; }
};

/// A quarter of a disc of radius 1 about the origin, or a polygon of the same chords.
inline FineMesh<2> quarter_disc(double spacing, double radius = 1.0) {
  PlanarDomain domain{.boundary = {{"rim", {}}}};
  auto& points = domain.boundary[0].points;
  points.emplace_back(0.0, 0.0);
  const int chords = std::max(4, static_cast<int>(std::ceil(0.5 * std::numbers::pi * radius / spacing)));
  for (int k = 0; k <= chords; ++k) {
    const double angle = 0.5 * std::numbers::pi * k / chords;
    points.emplace_back(k == chords ? 0.0 : radius * std::cos(angle), k == 0 ? 0.0 : radius * std::sin(angle));
  }
  points.emplace_back(0.0, 0.0);
  return triangulate(domain, {.size = spacing});
}

/// Gas of density and pressure 1 at rest in a box of side 1.
struct BoxOfGas {
  double spacing = 0.1;
  double until = 10.0;   ///< sound crosses the box in 0.85
  double stirred = 0.0;  ///< largest velocity at the start, of one vortex
};
struct BoxResult {
  double low, high;  ///< pressures at material points, at any time
  double deviation;  ///< largest standard deviation at a time
  double energy;     ///< error
  std::int64_t reconnections;
};
inline BoxResult run_box(const BoxOfGas& of, const GasOptions& options) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 1.0), {.size = of.spacing});
  DeformableBody<2> body =
      deformable_body(mesh, Fluid({.state = EquationOfState::ideal_gas(1.4), .pressure = 1.0}), 1.0);
  if (!options.patches) body.patches.clear();
  body.velocity.setZero(2, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const double x = std::numbers::pi * body.nodes(0, a), y = std::numbers::pi * body.nodes(1, a);
    body.velocity.col(a) = of.stirred * Vec<2>(std::sin(x) * std::cos(y), -std::cos(x) * std::sin(y));
  }
  Dynamics<2> dynamics({body}, otm<2>(options.scheme), options.dynamics);
  dynamics.add_wall({.normal = {1.0, 0.0}});
  dynamics.add_wall({.normal = {-1.0, 0.0}, .level = -1.0});
  dynamics.add_wall({.normal = {0.0, 1.0}});
  dynamics.add_wall({.normal = {0.0, -1.0}, .level = -1.0});
  BoxResult result{1.0, 1.0, 0.0, 0.0, 0};
  constexpr int looks = 100;
  for (int k = 1; k <= looks; ++k) {
    dynamics.run(of.until * k / looks);
    const GasSamples found = gas_samples(dynamics, 1.0);
    Spread spread;
    for (Index p = 0; p < found.x.cols(); ++p) spread.add(found.pressure[p], found.volume[p]);
    result.low = std::min(result.low, found.pressure.minCoeff());
    result.high = std::max(result.high, found.pressure.maxCoeff());
    result.deviation = std::max(result.deviation, spread.deviation());
  }
  result.energy = dynamics.energy().largest_error();
  result.reconnections = dynamics.count("reconnections");
  return result;
}

/// Noh's problem (Noh 1987): a cold gas of density 1 that flies against a wall, or into an axis, with speed 1.
/// A shock runs outwards with speed 1/3 (gamma 5/3), behind it density is 4, or 16.
struct Noh {
  bool cylindrical = false;
  double spacing = 0.02;
  double until = 0.6;
  static constexpr double gamma = 5.0 / 3.0, pressure = 1e-6;

  double shock() const { return until / 3.0; }
  double plateau() const { return cylindrical ? 16.0 : 4.0; }
  double pressure_behind() const { return plateau() / 3.0; }
  double exact(double r) const {
    if (r < shock()) return plateau();
    return cylindrical ? 1.0 + until / r : 1.0;
  }
};
struct NohResult {
  Spread density, pressure;   ///< behind the shock, by material points
  double mass_density = 0.0;  ///< there, mass of the nodes' points over the true volume
  double wall = 0.0;          ///< density next to the wall or the axis
  double error = 0.0;         ///< L1 of density over that of the exact one
  double shock = 0.0;         ///< where density is half of the plateau
  double energy = 0.0;
  Index steps = 0;
};

inline NohResult run_noh(const Noh& of, const GasOptions& options) {
  const double height = 4.0 * of.spacing;
  const FineMesh<2> mesh = of.cylindrical ? quarter_disc(of.spacing)
                                          : triangulate(shapes::rectangle(0.0, 0.0, 1.0, height), {.size = of.spacing});
  DeformableBody<2> body =
      deformable_body(mesh, Fluid({.state = EquationOfState::ideal_gas(Noh::gamma), .pressure = Noh::pressure}), 1.0);
  if (!options.patches) body.patches.clear();
  body.velocity.setZero(2, body.nodes.cols());
  for (Index a = 0; a < body.nodes.cols(); ++a) {
    const Vec<2> x = body.nodes.col(a);
    if (!of.cylindrical)
      body.velocity(0, a) = x[0] > 1e-9 ? -1.0 : 0.0;
    else if (x.norm() > 1e-9)
      body.velocity.col(a) = -x / x.norm();
  }
  Dynamics<2> dynamics({body}, otm<2>(options.scheme), options.dynamics);
  dynamics.add_wall({.normal = {1.0, 0.0}});
  dynamics.add_wall({.normal = {0.0, 1.0}});
  if (!of.cylindrical) dynamics.add_wall({.normal = {0.0, -1.0}, .level = -height});
  dynamics.run(of.until);
  const GasSamples found = gas_samples(dynamics, 1.0);
  NohResult result;
  const double low = 0.3 * of.shock(), high = 0.8 * of.shock();
  double mass = 0.0;
  Spread wall;
  constexpr int bins = 40;
  const double reach = 1.6 * of.shock();
  std::vector<Spread> rings(bins);
  const auto area = [&](double r) { return of.cylindrical ? 0.25 * std::numbers::pi * r * r : r * height; };
  double error = 0.0, norm = 0.0;
  for (Index p = 0; p < found.x.cols(); ++p) {
    const double r = of.cylindrical ? found.x.col(p).norm() : found.x(0, p);
    const double points_mass = found.volume[p] * found.density[p];
    if (r > low && r < high) {
      result.density.add(found.density[p], found.volume[p]);
      result.pressure.add(found.pressure[p], found.volume[p]);
      mass += points_mass;
    }
    if (r < 0.15 * of.shock()) wall.add(found.density[p], found.volume[p]);
    if (r < reach) {
      rings[std::min(bins - 1, static_cast<int>(r / reach * bins))].add(found.density[p], found.volume[p]);
      error += found.volume[p] * std::abs(found.density[p] - of.exact(r));
      norm += found.volume[p] * of.exact(r);
    }
  }
  result.mass_density = mass / (area(high) - area(low));
  result.wall = wall.mean;
  result.error = error / norm;
  for (int k = bins - 1; k >= 0 && result.shock == 0.0; --k)
    if (rings[k].mean > 0.5 * (of.plateau() + of.exact(of.shock() * 1.0001))) result.shock = (k + 0.5) / bins * reach;
  result.energy = dynamics.energy().largest_error();
  result.steps = dynamics.steps();
  return result;
}

/// Sedov's blast (Sedov 1959): energy that is there at once on an axis, in a gas of density 1 and nearly no pressure.
struct Sedov {
  double spacing = 0.02;
  double until = 1.0;
  static constexpr double gamma = 1.4, pressure = 1e-6;
  /// Of the full revolution and per length, such that the shock is at 0.75 at time 1; and over density R^4 / t^2 (Kamm
  /// & Timmes 2007).
  static constexpr double energy = 0.311357, alpha = 0.984041;

  double shock() const { return std::pow(energy * until * until / alpha, 0.25); }
  static double jump() { return (gamma + 1.0) / (gamma - 1.0); }
};
struct SedovResult {
  double shock = 0.0;  ///< radius of the largest density, by rings of half a spacing
  double peak = 0.0;   ///< density there
  double front = 0.0;  ///< radius within which the gas has moved
  double energy = 0.0;
  Index steps = 0;
};

inline SedovResult run_sedov(const Sedov& of, const GasOptions& options) {
  const FineMesh<2> mesh = quarter_disc(of.spacing);
  const double hot = 2.5 * of.spacing;
  double volume = 0.0;
  for (Index c = 0; c < mesh.num_cells(); ++c)
    if (mesh.centroid(c).norm() < hot) volume += mesh.volumes()[c];
  const double pressure = (Sedov::gamma - 1.0) * 0.25 * Sedov::energy / volume;
  const auto at = [=](const Vec<3>& X) { return X.head<2>().norm() < hot ? pressure : Sedov::pressure; };
  DeformableBody<2> body =
      deformable_body(mesh, Fluid({.state = EquationOfState::ideal_gas(Sedov::gamma), .pressure = at}), 1.0);
  if (!options.patches) body.patches.clear();
  Dynamics<2> dynamics({body}, otm<2>(options.scheme), options.dynamics);
  dynamics.add_wall({.normal = {1.0, 0.0}});
  dynamics.add_wall({.normal = {0.0, 1.0}});
  dynamics.run(of.until);
  const GasSamples found = gas_samples(dynamics, 1.0);
  SedovResult result;
  const int rings = static_cast<int>(2.0 / of.spacing);
  std::vector<Spread> density(rings);
  for (Index p = 0; p < found.x.cols(); ++p)
    density[std::min(rings - 1, static_cast<int>(found.x.col(p).norm() * rings))].add(found.density[p],
                                                                                      found.volume[p]);
  for (int k = 0; k < rings; ++k)
    if (density[k].mean > result.peak) {
      result.peak = density[k].mean;
      result.shock = (k + 0.5) / rings;
    }
  // Ahead of the shock density is one: half of the rise to the peak.
  for (int k = rings - 1; k > 0 && result.front == 0.0; --k)
    if (density[k].mean > 0.5 * (1.0 + result.peak)) result.front = (k + 0.5) / rings;
  result.energy = dynamics.energy().largest_error();
  result.steps = dynamics.steps();
  return result;
}

/// A cylinder of water that flies along its axis against a wall. SI units.
struct Jet {
  double spacing = 0.005;
  static constexpr double radius = 0.05, length = 0.4, speed = 116.0, density = 950.0;
  static constexpr double from = 1.2e-3, until = 2.6e-3;  ///< after the shock of the impact, before the jet ends

  static EquationOfState water() { return EquationOfState::mie_grueneisen({density, 1480.0, 1.92, 0.1}); }
  static double stagnation_pressure() { return 0.5 * density * speed * speed; }
};
struct JetResult {
  Spread pressure;     ///< at material points next to the stagnation point, over time
  Spread means;        ///< of the mean there, over time
  double force = 0.0;  ///< on the wall, mean, over density speed^2 area
  double energy = 0.0;
  std::int64_t reconnections = 0;
  Index steps = 0;
};

inline JetResult run_jet(const Jet& of, const GasOptions& options) {
  const FineMesh<2> mesh = triangulate(shapes::rectangle(0.0, 0.0, Jet::radius, Jet::length), {.size = of.spacing});
  DeformableBody<2> body = deformable_body(mesh, Fluid({.state = Jet::water()}), Jet::density, true);
  if (!options.patches) body.patches.clear();
  body.velocity.setZero(2, body.nodes.cols());
  body.velocity.row(1).setConstant(-Jet::speed);
  DynamicsOptions dynamics_options = options.dynamics;
  dynamics_options.plane = Plane::axisymmetric;
  Dynamics<2> dynamics({body}, otm<2>(options.scheme), dynamics_options);
  dynamics.add_wall({.normal = {0.0, 1.0}});
  JetResult result;
  dynamics.run(Jet::from);
  const auto momentum = [&] { return dynamics.balance().momentum[1]; };
  const double before = momentum();
  constexpr int looks = 1000;
  for (int k = 0; k < looks; ++k) {
    dynamics.run(Jet::from + (Jet::until - Jet::from) * (k + 1) / looks);
    const GasSamples found = gas_samples(dynamics, Jet::density);
    Spread around;
    for (Index p = 0; p < found.x.cols(); ++p)
      if (found.x.col(p).norm() < 0.2 * Jet::radius) {
        result.pressure.add(found.pressure[p], 1.0);
        around.add(found.pressure[p], 1.0);
      }
    result.means.add(around.mean, 1.0);
  }
  result.force = (momentum() - before) / (Jet::until - Jet::from) /
                 (Jet::density * Jet::speed * Jet::speed * std::numbers::pi * Jet::radius * Jet::radius);
  result.energy = dynamics.energy().largest_error();
  result.reconnections = dynamics.count("reconnections");
  result.steps = dynamics.steps();
  return result;
}

}  // namespace efree::bench
