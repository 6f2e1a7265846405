// SPDX-License-Identifier: GPL-3.0-or-later
/// Scenes of contact with closed forms, for tests and benchmarks.
#pragma once

#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/schemes/otm/otm.hpp"
#include "efree/dynamics/schemes/total_lagrangian/total_lagrangian.hpp"
#include "efree/geometry/meshing/planar_domain.hpp"
#include "efree/materials/hyperelastic.hpp"
#include "efree/quadrature/approximation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace efree::bench {

/// Holds the nodes that are not above that height at the start.
inline void hold_below(double height, Dynamics<2>& dynamics) {
  for (const int axis : {0, 1}) dynamics.prescribe([=](const Vec<2>& x) { return x[1] < height + 1e-9; }, axis, 0.0);
}

/// What a block slides on, and how it is discretised.
enum class Slope { wall, moving_plane, body, wall_under_cloud };

/// A block of rubber, 1 m by 0.5 m, on a plane with a slope of 30 degrees.
struct Incline {
  Slope slope = Slope::wall;
  double friction = 0.5;
  double spacing = 0.125;  ///< of nodes [m]
  double ramp = 0.3;       ///< time in which gravity, 10 m/s^2, grows [s]; 0: it is there at once
  double end = 1.0;        ///< [s]
};
struct Slide {
  double speed, rigid_speed;  ///< mean of the block's at the end, and of a rigid one [m/s]
  double free_speed;          ///< of one without friction
  double energy_error;
};

inline Slide slide_down(const Incline& of) {
  constexpr double gravity = 10.0, angle = std::numbers::pi / 6.0;
  const auto rubber = NeoHookean({.E = 1e8, .nu = 0.3});
  const auto part = [&](double x0, double y0, double x1, double y1) {
    const auto mesh = triangulate(shapes::rectangle(x0, y0, x1, y1), {.size = of.spacing});
    if (of.slope != Slope::wall_under_cloud) return deformable_body(mesh, rubber, 1000.0);
    return deformable_body(approximate(mesh, {.spacing = of.spacing}), rubber, 1000.0);
  };
  std::vector<DeformableBody<2>> bodies{part(0.0, 0.0, 1.0, 0.5)};
  if (of.slope == Slope::body) bodies.push_back(part(-0.5, -0.25, 1.5 + 3.0 * of.end, 0.0));
  auto scheme = of.slope == Slope::wall_under_cloud ? total_lagrangian<2>() : otm<2>();
  Dynamics<2> dynamics(bodies, std::move(scheme), {.contact = {.friction = of.friction}});
  const Vec<2> up = Vec<2>::Unit(1), full(gravity * std::sin(angle), -gravity * std::cos(angle));
  const auto factor = [&](double t) { return of.ramp > 0.0 ? std::min(1.0, t / of.ramp) : 1.0; };
  if (of.slope == Slope::body) {
    hold_below(-0.25, dynamics);
  } else if (of.slope == Slope::moving_plane) {
    // The plane falls off under the block instead.
    const auto speed = [=](double t) {
      return of.ramp > 0.0 && t < of.ramp ? 0.5 * t * t / of.ramp : t - 0.5 * of.ramp;
    };
    dynamics.add_rigid_body({.shape = rigid_shapes::half_space<2>(up, 0.0),
                             .friction = of.friction,
                             .velocity = [=](double t) -> Vec<2> { return -speed(t) * full; }});
  } else {
    dynamics.add_wall({.normal = up, .level = 0.0, .friction = of.friction});
  }
  while (dynamics.time() < of.end) {
    if (of.slope != Slope::moving_plane && dynamics.time() <= of.ramp + 0.01)
      dynamics.set_gravity(factor(dynamics.time()) * full);
    dynamics.step(dynamics.step_towards(of.end - dynamics.time()));
  }
  const auto block = dynamics.first_node(1);
  double speed =
      dynamics.velocities().row(0).head(block).dot(dynamics.masses().head(block)) / dynamics.masses().head(block).sum();
  if (of.slope == Slope::moving_plane) speed -= dynamics.rigid_bodies()[0].velocity[0];
  const double free_speed = gravity * std::sin(angle) * (of.end - 0.5 * of.ramp);
  return {.speed = speed,
          .rigid_speed = free_speed * std::max(0.0, 1.0 - of.friction / std::tan(angle)),
          .free_speed = free_speed,
          .energy_error = dynamics.energy().largest_error()};
}

/// A heavy stiff block that is let go on a soft column of as many cells, 0.4 m high.
struct Column {
  double sag;          ///< mean of the block's over its first periods, over that of the closed form
  double period;       ///< likewise
  double penetration;  ///< largest of nodes of either body, over the spacing
  double step;         ///< mean time step over that of the block alone
  double energy_error;
};

/// Three periods of a sag that swings, from where it is largest for the first time.
class Swing {
 public:
  /// The sag after a step, and its speed at that time.
  void add(double time, double dt, double sag, double speed) {
    if (speed_ > 0.0 && speed <= 0.0 && !is_over()) turns_.push_back(time - dt * speed / (speed - speed_));
    if (!turns_.empty() && !is_over()) {
      sum_ += dt * sag;
      time_ += dt;
    }
    speed_ = speed;
  }
  bool is_over() const { return turns_.size() == 4; }
  /// Both NaN before it is over.
  double mean() const { return is_over() ? sum_ / time_ : std::numeric_limits<double>::quiet_NaN(); }
  double period() const {
    return is_over() ? (turns_.back() - turns_.front()) / 3.0 : std::numeric_limits<double>::quiet_NaN();
  }

 private:
  std::vector<double> turns_;
  double speed_ = 0.0, sum_ = 0.0, time_ = 0.0;
};

/// That of a mass that is let go on a column of neo-Hookean material without Poisson's ratio, of that stiffness times
/// section: force EA (1 / l - l) / 2 by the stretch l. A third of the column moves with it, half weighs on it.
inline Swing neo_hookean_spring(double EA, double height, double mass, double column, double gravity) {
  const double inert = mass + column / 3.0, weight = (mass + column / 2.0) * gravity;
  const double dt = 1e-4 * std::sqrt(inert * height / EA);
  Swing swing;
  double sag = 0.0, speed = 0.5 * dt * weight / inert;
  for (double time = 0.0; !swing.is_over(); time += dt) {
    sag += dt * speed;
    const double stretch = 1.0 - sag / height;
    speed += dt * (weight - 0.5 * EA * (1.0 / stretch - stretch)) / inert;
    swing.add(time + 1.5 * dt, dt, sag, speed);
  }
  return swing;
}

inline Column press_column(int cells) {
  constexpr double gravity = 10.0, height = 0.4, side = 0.5, stiffness = 1e6, mass = 1e4 * side * side;
  const double spacing = height / cells;
  const auto part = [&](double y0, double y1, double E, double density) {
    const auto mesh = triangulate(shapes::rectangle(0.0, y0, side, y1), {.size = spacing});
    return deformable_body(mesh, NeoHookean({.E = E, .nu = 0.0}), density);
  };
  const std::vector<DeformableBody<2>> bodies{part(0.0, height, stiffness, 100.0),
                                              part(height, height + side, 1e9, 1e4)};
  Dynamics<2> dynamics(bodies, otm<2>()), alone({bodies[1]}, otm<2>());
  dynamics.set_gravity({0.0, -gravity});
  const Index first = dynamics.first_node(1), N = dynamics.num_nodes();
  hold_below(0.0, dynamics);
  const Points<2> start = dynamics.nodes();
  const auto masses = dynamics.masses().segment(first, N - first);
  const Swing exact = neo_hookean_spring(stiffness * side, height, mass, 100.0 * side * height, gravity);
  Swing swing;
  double penetration = 0.0;
  while (!swing.is_over() && dynamics.time() < 5.0 * exact.period()) {
    const double dt = dynamics.step();
    const Points<2>& x = dynamics.nodes();
    const double moved = -(x.row(1) - start.row(1)).segment(first, N - first).dot(masses) / masses.sum();
    const double speed = dynamics.velocities().row(1).segment(first, N - first).dot(masses) / masses.sum();
    swing.add(dynamics.time() - 0.5 * dt, dt, moved, -speed);
    for (Index a = 0; a < first; ++a)
      for (Index b = first; b < N; ++b)
        if (std::abs(start(1, a) - height) + std::abs(start(1, b) - height) < 1e-9)
          penetration = std::max(penetration, x(1, a) - x(1, b));
  }
  return {.sag = swing.mean() / exact.mean(),
          .period = swing.period() / exact.period(),
          .penetration = penetration / spacing,
          .step = dynamics.time() / static_cast<double>(dynamics.steps()) / alone.stable_step(),
          .energy_error = dynamics.energy().largest_error()};
}

/// What a disc that slides at first, of radius 0.5 m and speed 1 m/s, rolls on.
enum class Alley { wall, body };

/// Of a disc after it slid, which rolls from 0.11 s on.
struct Rolling {
  double speed;  ///< over the 2/3 of the speed that it is left by friction
  double slip;   ///< speed of its lowest place, over its own
  double energy_error;
};

/// A disc of rubber with that many edges on a wall or body; none: a rigid one.
inline Rolling roll(Alley alley, int edges) {
  constexpr double gravity = 10.0, friction = 0.3, radius = 0.5, speed = 1.0, end = 0.3;
  const auto rubber = NeoHookean({.E = 1e8, .nu = 0.3});
  std::vector<DeformableBody<2>> bodies;
  // A rigid disc sinks in between nodes of a body; on a wall a run still has a body, far away.
  const double far = alley == Alley::wall ? 10.0 : 0.0, size_below = edges == 0 ? 0.02 : 0.0625;
  if (alley == Alley::body || edges == 0)
    bodies.push_back(deformable_body(triangulate(shapes::rectangle(-0.5, far - 0.25, 0.75, far), {.size = size_below}),
                                     rubber, 1000.0));
  if (edges > 0) {
    PlanarDomain disc{.boundary = {{"", {}}}};
    for (int k = 0; k <= edges; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k % edges) / edges;
      disc.boundary[0].points.emplace_back(radius * std::sin(angle), radius - radius * std::cos(angle));
    }
    const double size = 2.0 * std::numbers::pi * radius / edges;
    DeformableBody<2> body = deformable_body(triangulate(disc, {.size = std::max(size, 0.05)}), rubber, 1000.0);
    body.velocity = Vec<2>(speed, 0.0).replicate(1, body.nodes.cols());
    bodies.push_back(std::move(body));
  }
  Dynamics<2> dynamics(bodies, otm<2>(), {.contact = {.friction = friction}});
  if (alley == Alley::body) hold_below(-0.25, dynamics);
  if (alley == Alley::wall) dynamics.add_wall({.normal = Vec<2>::Unit(1), .level = 0.0, .friction = friction});
  if (edges == 0) {
    const Vec<2> centre(0.0, radius);
    const double mass = 1000.0 * std::numbers::pi * radius * radius;
    RigidBody<2> ball{
        .shape = rigid_shapes::ball<2>(centre, radius), .friction = friction, .centre = centre, .mass = mass};
    ball.inertia = 0.5 * mass * radius * radius;
    ball.velocity = [=](double) { return Vec<2>(speed, 0.0); };
    ball.corners = centre;
    ball.round = radius;
    dynamics.add_rigid_body(ball);
  }
  dynamics.set_gravity({0.0, -gravity});
  dynamics.run(end);
  double along = 0.0, spin = 0.0;
  if (edges == 0) {
    along = dynamics.rigid_bodies()[0].velocity[0];
    spin = dynamics.rigid_bodies()[0].spin[0];
  } else {
    const Index b = static_cast<Index>(bodies.size()) - 1, first = dynamics.first_node(b),
                count = dynamics.first_node(b + 1) - first;
    const Points<2> x = dynamics.nodes().middleCols(first, count), v = dynamics.velocities().middleCols(first, count);
    const Vector mass = dynamics.masses().segment(first, count);
    const Vec<2> centre = x * mass / mass.sum(), mean = v * mass / mass.sum();
    double inertia = 0.0;
    for (Index a = 0; a < count; ++a) {
      const Vec<2> arm = x.col(a) - centre, relative = v.col(a) - mean;
      inertia += mass[a] * arm.squaredNorm();
      spin += mass[a] * (arm[0] * relative[1] - arm[1] * relative[0]);
    }
    spin /= inertia;
    along = mean[0];
  }
  return {.speed = along / (2.0 / 3.0 * speed),
          .slip = (along + radius * spin) / along,
          .energy_error = dynamics.energy().largest_error()};
}

}  // namespace efree::bench
