// SPDX-License-Identifier: GPL-3.0-or-later
/// Quasi-static processes with mass scaling: blocks, bars, plates, beams and rings, fast and slow.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/materials/j2.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace efree::bench {

/// A body, and the force that drives it. Densities are 1e-4 and moduli 1: waves in a bar travel 100 in a time of 1.
struct ScalingScene {
  std::string name;
  double time = 0.0;  ///< of the process
  std::function<Dynamics<2>(const MassScaling&)> make;
  /// Force that drives it, now; empty: `impulse`.
  std::function<double(const Dynamics<2>&)> force{};
  /// Impulse of that force so far.
  std::function<double(const Dynamics<2>&)> impulse{};
};

/// How a process goes.
struct Loading {
  bool is_smooth = false;  ///< speeds start and stop as a cosine does; else they are constant
  double time = 0.0;

  double speed(double way, double t) const {
    return way / time * (is_smooth ? 1.0 - std::cos(2.0 * std::numbers::pi * t / time) : 1.0);
  }
  std::string text(bool is_metal) const {
    return fmt::format("{}, {}, T {}", is_metal ? "metal" : "rubber", is_smooth ? "smooth" : "abrupt", time);
  }
};

inline SharedMaterial scaling_material(bool is_metal, double nu = 0.3) {
  if (is_metal)
    return J2({.moduli = {.E = 1.0, .nu = 0.3}, .yield = Hardening::linear(0.01, 0.01), .strain = Strain::finite});
  return NeoHookean({.E = 1.0, .nu = nu});
}

inline double driving_impulse(const Dynamics<2>& dynamics) {
  return dynamics.rigid_bodies().back().impulse[1];
}
inline std::vector<Index> nodes_where(const Dynamics<2>& dynamics, const std::function<bool(const Vec<2>&)>& where) {
  std::vector<Index> result;
  for (Index a = 0; a < dynamics.num_nodes(); ++a)
    if (where(dynamics.nodes().col(a))) result.push_back(a);
  return result;
}
inline void hold(Dynamics<2>& dynamics, const std::function<bool(const Vec<2>&)>& where) {
  for (const int axis : {0, 1}) dynamics.prescribe(where, axis, 0.0);
}

/// A wall at that level, and a plate that comes down from a height of 1 by `way`, both with friction.
inline void press_between_plates(Dynamics<2>& dynamics, double level, const Loading& loading, double way) {
  dynamics.add_wall({.normal = {0.0, 1.0}, .level = level, .friction = 0.3});
  dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>({0.0, -1.0}, -1.0),
                           .friction = 0.3,
                           .velocity = [=](double t) { return Vec<2>(0.0, -loading.speed(way, t)); }});
}

/// A block on a wall that a plate presses by a fifth of its height of 1.
struct PressedBlock {
  bool is_metal = false;
  Loading loading{};
  double width = 1.0, damping = 0.0;
};
inline ScalingScene press_block(const PressedBlock& of) {
  return {.name = fmt::format("block {} wide{}, {}", of.width,
                              of.damping > 0.0 ? fmt::format(", damping {}", of.damping) : "",
                              of.loading.text(of.is_metal)),
          .time = of.loading.time,
          .make =
              [=](const MassScaling& scaling) {
                const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, of.width, 1.0), {.size = 0.1});
                Dynamics<2> dynamics({deformable_body(mesh, scaling_material(of.is_metal, 0.45), 1e-4)}, otm<2>(),
                                     {.damping = of.damping, .mass_scaling = scaling});
                press_between_plates(dynamics, 0.0, of.loading, 0.2);
                return dynamics;
              },
          .impulse = driving_impulse};
}

/// A stiff block on a soft one, pressed by a tenth.
inline ScalingScene press_stack(const Loading& loading) {
  return {.name = fmt::format("stiff on soft block, {}", loading.text(false)),
          .time = loading.time,
          .make =
              [=](const MassScaling& scaling) {
                const auto mesh = triangulate(shapes::rectangle(0.0, 0.0, 1.0, 0.5), {.size = 0.12});
                auto low = deformable_body(mesh, scaling_material(false), 1e-4),
                     high = deformable_body(mesh, NeoHookean({.E = 10.0, .nu = 0.3}), 1e-4);
                high.nodes.row(1).array() += 0.5;
                high.points.row(1).array() += 0.5;
                Dynamics<2> dynamics({low, high}, otm<2>(),
                                     {.mass_scaling = scaling, .contact = {.self = false, .friction = 0.3}});
                press_between_plates(dynamics, 0.0, loading, 0.1);
                return dynamics;
              },
          .impulse = driving_impulse};
}

/// A body held where `held` says, whose nodes at `driven` move along an axis by `way`.
struct DrivenBody {
  std::string name;
  PlanarDomain domain;
  double size = 0.1;
  std::function<void(Dynamics<2>&)> hold;
  std::function<bool(const Vec<2>&)> driven;
  int axis = 0;
  double way = 0.0;
  bool is_metal = false;
  Loading loading{};
};
inline ScalingScene drive(const DrivenBody& of) {
  const auto nodes = std::make_shared<std::vector<Index>>();
  return {.name = fmt::format("{}, {}", of.name, of.loading.text(of.is_metal)),
          .time = of.loading.time,
          .make =
              [=](const MassScaling& scaling) {
                Dynamics<2> dynamics(
                    {deformable_body(triangulate(of.domain, {.size = of.size}), scaling_material(of.is_metal), 1e-4)},
                    otm<2>(), {.mass_scaling = scaling, .contact = {.self = false}});
                of.hold(dynamics);
                *nodes = nodes_where(dynamics, of.driven);
                dynamics.prescribe(*nodes, of.axis,
                                   [=](const Vec<2>&, double t) { return of.loading.speed(of.way, t); });
                return dynamics;
              },
          .force =
              [=](const Dynamics<2>& dynamics) {
                double force = 0.0;
                for (const Index a : *nodes) force -= dynamics.world().nodes.force(of.axis, a);
                return force;
              }};
}

/// A strip clamped at its left end, whose other end moves along an axis.
inline ScalingScene drive_strip(double length, double height, int axis, double way, bool is_metal,
                                const Loading& loading) {
  return drive({.name = fmt::format("strip {} x {}, {}", length, height, axis == 0 ? "pulled" : "bent"),
                .domain = shapes::rectangle(0.0, 0.0, length, height),
                .size = height / 3.0,
                .hold = [](Dynamics<2>& dynamics) { hold(dynamics, [](const Vec<2>& x) { return x[0] < 1e-9; }); },
                .driven = [=](const Vec<2>& x) { return x[0] > length - 1e-9; },
                .axis = axis,
                .way = way,
                .is_metal = is_metal,
                .loading = loading});
}

/// A quarter of a plate with a hole, pulled by a tenth.
inline ScalingScene pull_plate(bool is_metal, const Loading& loading) {
  return drive({.name = "plate with a hole",
                .domain = shapes::quarter_plate_with_hole(0.3, 1.0, 0.06),
                .size = 0.12,
                .hold =
                    [](Dynamics<2>& dynamics) {
                      for (const int axis : {0, 1})
                        dynamics.prescribe([=](const Vec<2>& x) { return x[axis] < 1e-9; }, axis, 0.0);
                    },
                .driven = [](const Vec<2>& x) { return x[0] > 1.0 - 1e-9; },
                .way = 0.1,
                .is_metal = is_metal,
                .loading = loading});
}

/// An angle bracket, clamped at its foot, whose arm is bent.
inline ScalingScene bend_bracket(bool is_metal, const Loading& loading) {
  return drive({.name = "bracket",
                .domain = {.boundary = {{"rim", {{0, 0}, {0.2, 0}, {0.2, 0.8}, {1, 0.8}, {1, 1}, {0, 1}, {0, 0}}}}},
                .size = 0.08,
                .hold = [](Dynamics<2>& dynamics) { hold(dynamics, [](const Vec<2>& x) { return x[1] < 1e-9; }); },
                .driven = [](const Vec<2>& x) { return x[0] > 1.0 - 1e-9; },
                .axis = 1,
                .way = -0.15,
                .is_metal = is_metal,
                .loading = loading});
}

/// A beam on two discs that a third presses down, or (is_clamped) one clamped at its ends under an eccentric disc.
inline ScalingScene bend_beam(bool is_clamped, bool is_metal, const Loading& loading) {
  return {.name = fmt::format("{} beam, {}", is_clamped ? "clamped" : "supported", loading.text(is_metal)),
          .time = loading.time,
          .make =
              [=](const MassScaling& scaling) {
                const double half = is_clamped ? 1.0 : 1.2, height = is_clamped ? 0.15 : 0.2;
                const auto mesh = triangulate(shapes::rectangle(-half, 0.0, half, height), {.size = height / 3.0});
                Dynamics<2> dynamics({deformable_body(mesh, scaling_material(is_metal), 1e-4)}, otm<2>(),
                                     {.mass_scaling = scaling, .contact = {.self = false}});
                if (is_clamped)
                  hold(dynamics, [](const Vec<2>& x) { return std::abs(x[0]) > 1.0 - 1e-9; });
                else
                  for (const double x : {-1.0, 1.0})
                    dynamics.add_rigid_body({.shape = rigid_shapes::ball<2>({x, -0.2}, 0.2)});
                const Vec<2> centre(is_clamped ? 0.1 : 0.0, height + (is_clamped ? 0.31 : 0.2));
                dynamics.add_rigid_body(
                    {.shape = rigid_shapes::ball<2>(centre, is_clamped ? 0.3 : 0.2),
                     .velocity = [=](double t) { return Vec<2>(0.0, -loading.speed(is_clamped ? 0.25 : 0.3, t)); }});
                return dynamics;
              },
          .impulse = driving_impulse};
}

/// A ring on a wall that a plate presses by a fifth.
inline ScalingScene press_ring(bool is_metal, const Loading& loading) {
  return {.name = fmt::format("ring, {}", loading.text(is_metal)),
          .time = loading.time,
          .make =
              [=](const MassScaling& scaling) {
                PlanarDomain domain{.boundary = {{"rim", {}}, {"hole", {}}}};
                for (int k = 0; k <= 40; ++k) {
                  const double angle = 2.0 * std::numbers::pi * (k % 40) / 40.0;
                  const Vec<2> at(std::cos(angle), std::sin(angle));
                  domain.boundary[0].points.push_back(at);
                  domain.boundary[1].points.push_back(0.8 * at);
                }
                Dynamics<2> dynamics(
                    {deformable_body(triangulate(domain, {.size = 0.1}), scaling_material(is_metal), 1e-4)}, otm<2>(),
                    {.mass_scaling = scaling, .contact = {.self = false}});
                press_between_plates(dynamics, -1.0, loading, 0.4);
                return dynamics;
              },
          .impulse = driving_impulse};
}

struct ScalingResult {
  std::vector<double> force;  ///< means over hundredths of the time
  AddedInertia inertia;
  Index steps = 0;
};

inline ScalingResult run_scaling(const ScalingScene& scene, const MassScaling& scaling) {
  Dynamics<2> dynamics = scene.make(scaling);
  constexpr int parts = 100;
  ScalingResult result;
  double before = 0.0, impulse = 0.0;
  for (int k = 1; k <= parts; ++k) {
    const double until = scene.time * k / parts;
    while (dynamics.time() < until * (1.0 - 1e-12)) {
      const double dt = dynamics.step(dynamics.step_towards(until - dynamics.time()));
      if (scene.force) impulse += dt * scene.force(dynamics);
    }
    if (scene.impulse) impulse = scene.impulse(dynamics);
    result.force.push_back((impulse - before) / (scene.time / parts));
    before = impulse;
  }
  result.inertia = dynamics.added_inertia();
  result.steps = dynamics.steps();
  return result;
}

inline double largest_force(const ScalingResult& of) {
  double largest = 0.0;
  for (const double force : of.force) largest = std::max(largest, std::abs(force));
  return largest;
}

/// Largest difference of the forces, over the largest of the second.
inline double scaling_error(const ScalingResult& scaled, const ScalingResult& real) {
  double error = 0.0;
  for (std::size_t k = 0; k < real.force.size(); ++k)
    error = std::max(error, std::abs(scaled.force[k] - real.force[k]));
  return error / largest_force(real);
}

/// Blocks of rubber and metal in more than 400 times that a wave takes across, the most common processes.
inline std::vector<ScalingScene> slow_blocks() {
  std::vector<ScalingScene> result;
  for (const bool is_metal : {false, true})
    for (const bool is_smooth : {false, true})
      result.push_back(press_block({.is_metal = is_metal, .loading = {is_smooth, 4.0}}));
  return result;
}

/// Processes that are fast, damped, or bend bodies.
inline std::vector<ScalingScene> other_processes() {
  std::vector<ScalingScene> result;
  for (const double damping : {0.0, 3.0, 30.0})
    result.push_back(press_block({.loading = {false, 1.16}, .damping = damping}));
  result.push_back(press_block({.loading = {false, 2.0}, .width = 3.0}));
  result.push_back(press_block({.loading = {false, 4.0}, .damping = 30.0}));
  for (const bool is_smooth : {false, true})
    for (const bool is_slow : {false, true}) {
      result.push_back(drive_strip(1.0, 0.1, 1, 0.1, false, {is_smooth, is_slow ? 20.0 : 5.0}));
      result.push_back(drive_strip(4.0, 0.4, 0, 0.4, true, {is_smooth, is_slow ? 10.0 : 2.0}));
      result.push_back(press_stack({is_smooth, is_slow ? 4.0 : 0.6}));
      for (const bool is_metal : {false, true}) {
        result.push_back(pull_plate(is_metal, {is_smooth, is_slow ? 5.0 : 1.0}));
        result.push_back(bend_beam(false, is_metal, {is_smooth, is_slow ? 15.0 : 3.0}));
        result.push_back(bend_beam(true, is_metal, {is_smooth, is_slow ? 12.0 : 2.0}));
        result.push_back(press_ring(is_metal, {is_smooth, is_slow ? 30.0 : 5.0}));
        result.push_back(bend_bracket(is_metal, {is_smooth, is_slow ? 20.0 : 3.0}));
      }
    }
  return result;
}

}  // namespace efree::bench
