// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and tools against nodes.
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/otm/internal/motion.hpp"

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace efree::internal {
namespace {

/// Part of the normal that is free below which a node is held against the tool.
constexpr double least_free = 1e-3;

/// Velocity and spin of a tool as one vector, and what they make of the velocity at an arm's length.
template <int Dim> constexpr int freedoms = Dim + (Dim == 2 ? 1 : 3);
template <int Dim> Eigen::Matrix<double, Dim, freedoms<Dim>> motion_at(const Vec<Dim>& arm) {
  Eigen::Matrix<double, Dim, freedoms<Dim>> result;
  result.template leftCols<Dim>().setIdentity();
  if constexpr (Dim == 2)
    result.col(2) = Vec<2>(-arm[1], arm[0]);
  else
    for (int j = 0; j < 3; ++j) result.col(3 + j) = Vec<3>::Unit(j).cross(arm);
  return result;
}

template <int Dim> Mat<Dim> rotation(const Spin<Dim>& by) {
  if constexpr (Dim == 2)
    return Eigen::Rotation2Dd(by[0]).toRotationMatrix();
  else
    return by.norm() > 0.0 ? Eigen::AngleAxisd(by.norm(), by.normalized()).toRotationMatrix() : Mat<3>::Identity();
}

}  // namespace

template <int Dim> void Motion<Dim>::Tool::take(const Vec<Dim>& at, const Vec<Dim>& impulse) {
  pushed -= impulse;
  turned -= torque_of<Dim>(at - now.centre, impulse);
}

template <int Dim> void Motion<Dim>::add_tool(const OtmTool<Dim>& tool, bool is_wall) {
  const auto fail = [](const std::string& what) { throw InputError("a tool: " + what); };
  if (!tool.shape) fail("expected a shape");
  if (!(tool.friction >= 0.0)) fail(fmt::format("friction {}, expected 0 or more", tool.friction));
  if (!tool.centre.allFinite()) fail("expected a centre");
  if (!(tool.mass >= 0.0) || !(tool.inertia >= 0.0) || !std::isfinite(tool.mass) || !std::isfinite(tool.inertia))
    fail("expected a mass and a moment of inertia of 0 or more");
  if (axisymmetric() && tool.inertia > 0.0) fail("in an axisymmetric section it does not turn: expected no inertia");
  const bool is_free = tool.mass > 0.0 || tool.inertia > 0.0;
  if (is_free && std::ranges::any_of(bodies, [](const BodyOf& body) { return body.has_surface; }))
    fail("a mass is for bodies whose nodes are their surface, not for those on a cloud");
  const ToolState<Dim> at_rest{.centre = tool.centre,
                               .velocity = Vec<Dim>::Zero(),
                               .turned = Mat<Dim>::Identity(),
                               .spin = Spin<Dim>::Zero(),
                               .force = Vec<Dim>::Zero(),
                               .impulse = Vec<Dim>::Zero(),
                               .work = 0.0};
  Tool added{.of = tool, .is_wall = is_wall, .now = at_rest, .before = at_rest};
  added.of.mass = added.of.inertia = 0.0;
  lead(added, time);
  added.of.mass = tool.mass;
  added.of.inertia = tool.inertia;
  added.before = added.now;
  tools.push_back(std::move(added));
  looked.resize(Dim, 0);
}

/// Velocity and spin that are prescribed at that time.
template <int Dim> void Motion<Dim>::lead(Tool& tool, double at_time) const {
  if (tool.of.mass == 0.0 && tool.of.velocity) tool.now.velocity = tool.of.velocity(at_time);
  if (tool.of.inertia == 0.0 && tool.of.spin) tool.now.spin = tool.of.spin(at_time);
  if (!tool.now.velocity.allFinite() || !tool.now.spin.allFinite())
    throw InputError(fmt::format("a tool: its velocity at time {:.6g} is no number", at_time));
  if (axisymmetric() && (tool.now.velocity[0] != 0.0 || !tool.now.spin.isZero(0.0)))
    throw InputError(
        fmt::format("a tool: at time {:.6g} it leaves the axis of an axisymmetric section, expected a velocity along y "
                    "alone and no spin",
                    at_time));
}

/// Of nodes that are no surface's.
template <int Dim> void Motion<Dim>::find_gaps(const Tool& tool) {
  gaps.resize(static_cast<std::size_t>(x.cols()));
  parallel_for(static_cast<Index>(x.cols()), [&](Index a) {
    if (bodies[body_of_node[a]].has_surface || !(mass[a] > 0.0))
      gaps[a] = {std::numeric_limits<double>::infinity(), Vec<Dim>::Zero()};
    else
      gaps[a] = gap_to<Dim>(tool.of, tool.now, x.col(a));
  });
}

/// The impulse that keeps a node out of a tool in this step, and lets it slide as Coulomb's law does; `slope`: its
/// derivative by the tool's velocity there. Along axes that are prescribed there is none.
template <int Dim> Vec<Dim> Motion<Dim>::stop_at(const Tool& tool, Index a, double dt, Mat<Dim>* slope) const {
  const Vec<Dim>& normal = gaps[a].normal;
  const double gap = gaps[a].gap;
  if (slope) slope->setZero();
  if (!(gap < std::numeric_limits<double>::infinity())) return Vec<Dim>::Zero();
  const Vec<Dim> speed = v.col(a) - velocity_of<Dim>(tool.now, x.col(a));
  // What is inside comes out within a stable step, not at once where a step is cut short.
  const double stop = -normal.dot(speed) - gap / (gap < 0.0 ? std::max(dt, stable) : dt);
  if (!(stop > 0.0)) return Vec<Dim>::Zero();
  const Vec<Dim> way = free.col(a).cwiseProduct(normal);
  const double part = way.squaredNorm();
  if (part < least_free) return Vec<Dim>::Zero();
  const Vec<Dim> slides = free.col(a).cwiseProduct(Vec<Dim>(speed - normal.dot(speed) * normal));
  const double sliding = slides.norm(), most = tool.of.friction * stop;
  const double hold = sliding > most ? most / sliding : 1.0;
  if (slope) {
    *slope = way * normal.transpose() / part;
    Mat<Dim> along = free.col(a).asDiagonal() * (Mat<Dim>::Identity() - normal * normal.transpose());
    if (hold < 1.0) {
      const Vec<Dim> one = slides / sliding;
      along -= one * (one.transpose() * along).eval();
      *slope -= tool.of.friction * one * normal.transpose();
    }
    *slope = mass[a] * (*slope + hold * along);
  }
  return mass[a] * (stop / part * way - hold * slides);
}

/// Velocity and spin of a tool with a mass after it has met the nodes, by Newton's method on its momenta, which are
/// piecewise linear in both without friction.
template <int Dim> void Motion<Dim>::yield_to_nodes(Tool& tool, double dt) const {
  constexpr int n = freedoms<Dim>;
  using Motions = Vec<n>;
  Motions inertia, start;
  inertia << Vec<Dim>::Constant(tool.of.mass), Spin<Dim>::Constant(tool.of.inertia);
  if (axisymmetric()) inertia[0] = 0.0;
  start << tool.now.velocity, tool.now.spin;
  double moved = 0.0;
  for (int iteration = 0; iteration < 50; ++iteration) {
    Motions q, off;
    q << tool.now.velocity, tool.now.spin;
    off = inertia.cwiseProduct(q - start);
    Mat<n> slope = inertia.asDiagonal();
    for (Index a = 0; a < static_cast<Index>(x.cols()); ++a) {
      Mat<Dim> by;
      const Vec<Dim> impulse = stop_at(tool, a, dt, &by);
      if (impulse.isZero(0.0)) continue;
      const auto at = motion_at<Dim>(x.col(a) - tool.now.centre);
      off += at.transpose() * impulse;
      slope += at.transpose() * by * at;
    }
    for (int i = 0; i < n; ++i)
      if (inertia[i] == 0.0) {
        slope.row(i).setZero();
        slope(i, i) = 1.0;
        off[i] = 0.0;
      }
    const Motions step = slope.partialPivLu().solve(off);
    q -= step;
    tool.now.velocity = q.template head<Dim>();
    tool.now.spin = q.template tail<n - Dim>();
    moved = std::max(moved, step.norm());
    if (step.norm() <= 1e-13 * moved) break;
  }
}

/// Nodes meet walls and tools, one after the other.
template <int Dim> void Motion<Dim>::hold_back(double kick, double dt) {
  hits.clear();
  for (std::size_t k = 0; k < tools.size(); ++k) {
    Tool& tool = tools[k];
    tool.before = tool.now;
    tool.pushed.setZero();
    tool.turned.setZero();
    lead(tool, time + 0.5 * dt);
    if (tool.of.mass > 0.0) tool.now.velocity += kick * acceleration;
    const Vec<Dim> falling = tool.now.velocity;
    stop_surfaces(tool, dt);
    find_gaps(tool);
    if (tool.of.mass > 0.0 || tool.of.inertia > 0.0) yield_to_nodes(tool, dt);
    for (Index a = 0; a < static_cast<Index>(x.cols()); ++a) {
      const Vec<Dim> impulse = stop_at(tool, a, dt, nullptr);
      if (impulse.isZero(0.0)) continue;
      tool.take(x.col(a), impulse);
      hits.push_back({k, a, impulse});
    }
    for (std::size_t h = hits.size(); h-- > 0 && hits[h].tool == k;)
      v.col(hits[h].node) += hits[h].impulse / mass[hits[h].node];
    // Its momentum is what they gave it, to rounding.
    const double axial = axisymmetric() ? 0.0 : 1.0;
    if (tool.of.mass > 0.0) {
      tool.now.velocity = falling + tool.pushed / tool.of.mass;
      tool.now.velocity[0] *= axial;
    }
    if (tool.of.inertia > 0.0) tool.now.spin = tool.before.spin + tool.turned / tool.of.inertia;
  }
}

/// What tools took of the nodes' energy, and where they go.
template <int Dim> void Motion<Dim>::move_tools(double kick, double dt) {
  for (const Hit& hit : hits) {
    const Vec<Dim> slip = 0.5 * (v.col(hit.node) + was.col(hit.node)) - tools[hit.tool].mean_velocity(x.col(hit.node));
    contact_loss -= hit.impulse.dot(slip);
  }
  for (Tool& tool : tools) {
    const double pushes = -0.5 * tool.pushed.dot(tool.before.velocity + tool.now.velocity),
                 turns = -0.5 * tool.turned.dot(tool.before.spin + tool.now.spin);
    tool.now.work += pushes + turns;
    if (tool.of.mass == 0.0) prescribed_work += pushes;
    if (tool.of.inertia == 0.0) prescribed_work += turns;
    tool.now.force = tool.pushed / kick;
    tool.now.impulse += tool.pushed;
    tool.now.centre += dt * tool.now.velocity;
    if (!tool.now.spin.isZero(0.0)) tool.now.turned = rotation<Dim>(dt * tool.now.spin) * tool.now.turned;
    tool.travelled += tool.now.spin.isZero(0.0) ? dt * tool.now.velocity.norm() : surface_skin;
  }
}

template struct Motion<2>;
template struct Motion<3>;

}  // namespace efree::internal
