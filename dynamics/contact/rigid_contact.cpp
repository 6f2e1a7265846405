// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and rigid bodies against nodes.
#include "efree/dynamics/contact/internal/rigid_contact.hpp"

#include "efree/dynamics/points.hpp"

#include <fmt/format.h>

namespace efree::internal {
namespace {

/// Nodes of a range that one thread brings into contact.
constexpr Index nodes_at_once = 512;
/// Squared length of the normal along the free axes below which a node is fixed against the rigid body.
constexpr double least_free = 1e-3;

/// Velocity and spin of a rigid body as one vector, and the matrix from these to its velocity at the end of an arm.
template <int Dim> constexpr int freedoms = Dim + (Dim == 2 ? 1 : 3);
template <int Dim> Eigen::Matrix<double, Dim, freedoms<Dim>> velocity_matrix(const Vec<Dim>& arm) {
  Eigen::Matrix<double, Dim, freedoms<Dim>> result;
  result.template leftCols<Dim>().setIdentity();
  if constexpr (Dim == 2)
    result.col(2) = Vec<2>(-arm[1], arm[0]);
  else
    for (int j = 0; j < 3; ++j) result.col(3 + j) = Vec<3>::Unit(j).cross(arm);
  return result;
}

template <int Dim> Mat<Dim> rotation(const Spin<Dim>& angle) {
  if constexpr (Dim == 2)
    return Eigen::Rotation2Dd(angle[0]).toRotationMatrix();
  else
    return angle.norm() > 0.0 ? Eigen::AngleAxisd(angle.norm(), angle.normalized()).toRotationMatrix()
                              : Mat<3>::Identity();
}

/// Sets velocity and spin where they are prescribed, to those at that time.
template <int Dim>
void prescribe_motion(const World<Dim>& world, const RigidBody<Dim>& body, double time, RigidState<Dim>& now) {
  if (body.mass == 0.0 && body.velocity) now.velocity = body.velocity(time);
  if (body.inertia == 0.0 && body.spin) now.spin = body.spin(time);
  if (world.stands_still) {
    now.velocity.setZero();
    now.spin.setZero();
  }
  if (!now.velocity.allFinite() || !now.spin.allFinite())
    throw InputError(fmt::format("a rigid body: its velocity at time {:.6g} is not finite", time));
  if (world.axisymmetric() && (now.velocity[0] != 0.0 || !now.spin.isZero(0.0)))
    throw InputError(fmt::format(
        "a rigid body: at time {:.6g} it leaves the axis of an axisymmetric section, expected a velocity along y alone "
        "and no spin",
        time));
}

/// Velocities at the start, which are prescribed of one with a mass, too.
template <int Dim>
void begin_motion(const World<Dim>& world, const RigidBody<Dim>& body, double time, RigidState<Dim>& now) {
  RigidBody<Dim> massless = body;
  massless.mass = massless.inertia = 0.0;
  now.velocity.setZero();
  now.spin.setZero();
  prescribe_motion(world, massless, time, now);
  if (body.mass > 0.0) now.velocity.array() *= body.free_axes().array();
}

/// Of a rigid body with a mass, by gravity at its centre and its own force.
template <int Dim>
Vec<Dim> acceleration(const World<Dim>& world, const RigidBody<Dim>& body, const Vec<Dim>& centre, double time) {
  Vec<Dim> result = world.gravity;
  if (world.gravity_field) result += world.field_at(centre, time);
  if (body.force) result += body.force(time) / body.mass;
  return body.free_axes().cwiseProduct(result);
}

}  // namespace

template <int Dim> void RigidContact<Dim>::add(const World<Dim>& world, const RigidBody<Dim>& body, bool is_wall) {
  const auto fail = [](const std::string& what) { throw InputError("a rigid body: " + what); };
  if (!body.shape) fail("expected a shape");
  if (!(body.friction >= 0.0)) fail(fmt::format("friction {}, expected 0 or more", body.friction));
  if (!body.centre.allFinite()) fail("expected a centre");
  if (!(body.mass >= 0.0) || !(body.inertia >= 0.0) || !std::isfinite(body.mass) || !std::isfinite(body.inertia))
    fail("expected a mass and a moment of inertia of 0 or more");
  if (world.axisymmetric() && body.inertia > 0.0)
    fail("in an axisymmetric section it does not rotate: expected no inertia");
  const Vec<Dim> none = Vec<Dim>::Zero();
  const RigidState<Dim> at_rest{body.centre, none, Mat<Dim>::Identity(), Spin<Dim>::Zero(), none, none, 0.0};
  const auto num_walls = static_cast<Index>(std::ranges::count_if(rigids_, &Rigid::is_wall));
  using Kind = ContactPartner::Kind;
  Rigid added{.body = body,
              .who = is_wall ? ContactPartner{Kind::wall, num_walls}
                             : ContactPartner{Kind::rigid_body, static_cast<Index>(rigids_.size()) - num_walls},
              .now = at_rest,
              .before = at_rest};
  if (body.force && body.mass == 0.0) fail("a force is for one with a mass");
  if (added.is_free() && std::ranges::any_of(world.surface_points.bodies, [](char has) { return has != 0; }))
    fail("a mass is for bodies whose nodes are their surface, not for those on a cloud");
  begin_motion(world, body, world.time, added.now);
  added.before = added.now;
  rigids_.push_back(std::move(added));
  x_searched_.resize(Dim, 0);
}

/// The forces by which the scheme itself holds nodes off a wall, if it does.
template <int Dim> const WallForces<Dim>* RigidContact<Dim>::held_by_scheme(const Rigid& rigid) const {
  const WallForces<Dim>* held = scheme_.wall_forces();
  return held && rigid.is_wall() && rigid.who.number < std::ssize(held->forces) ? held : nullptr;
}

/// Infinite where surface points are in contact instead.
template <int Dim> Gap<Dim> RigidContact<Dim>::gap_of_node(const World<Dim>& world, const Rigid& rigid, Index a) const {
  const Nodes<Dim>& nodes = world.nodes;
  if (world.surface_points.of(nodes.body[a]) || !(nodes.mass[a] > 0.0))
    return {std::numeric_limits<double>::infinity(), Vec<Dim>::Zero()};
  Gap<Dim> result = gap_to<Dim>(rigid.body, rigid.now, nodes.x.col(a));
  if (nodes.radius.size() != 0 && nodes.radius[a] > 0.0) {
    // Particles that a scheme holds off by forces are stopped only where these do not do. What overlaps is not pushed
    // out, which would make it fast: where particles end is known to a part of their size.
    const double share = held_by_scheme(rigid) ? 0.5 : 1.0;
    result.gap = std::max(result.gap - share * nodes.radius[a], 0.0);
  }
  return result;
}

/// The impulse that keeps a node out of a rigid body in this step, with Coulomb friction. pressed: impulse over the
/// mass of the node by which the scheme holds it off already, which friction counts too; `slope`: derivative of the
/// impulse with respect to the rigid body's velocity there. Along axes with prescribed velocity there is none.
template <int Dim>
typename RigidContact<Dim>::OnNode RigidContact<Dim>::on_node(const World<Dim>& world, const Rigid& rigid, Index a,
                                                              const Gap<Dim>& of, double dt, double pressed,
                                                              Mat<Dim>* slope) const {
  const Nodes<Dim>& nodes = world.nodes;
  const auto& [gap, normal] = of;
  const double mass = nodes.mass[a], mu = rigid.body.friction;
  if (slope) slope->setZero();
  OnNode result;
  const Vec<Dim> relative = nodes.v.col(a) - velocity_of<Dim>(rigid.now, nodes.x.col(a));
  // Nodes inside move out within a stable step, not at once where a step is cut short.
  const double change = std::max(0.0, -normal.dot(relative) - gap / (gap < 0.0 ? std::max(dt, world.stable_step) : dt));
  const bool is_pressed = change + pressed > 0.0;
  if (!is_pressed && !(gap < forgotten_gap * nodes.spacing[a])) return result;
  const Vec<Dim> direction = nodes.free.col(a).cwiseProduct(normal);
  const double part = direction.squaredNorm();
  if (part < least_free) return result;
  double most = 0.0, gain = 0.0;  // of friction over the mass, and by `change`
  if (!rigid.friction.empty()) {
    result.friction = rigid.friction[a];
    result.friction.press(mu * mass * (change + pressed), dt, longest_delay(world));
    if (is_pressed || gap < friction_gap * nodes.spacing[a]) {
      most = result.friction.limit() / mass;
      gain = mu * result.friction.gain();
      result.friction.grant();
    }
  } else if (is_pressed && mu > 0.0) {
    most = std::numeric_limits<double>::infinity();
  }
  if (!(change > 0.0) && !(most > 0.0)) return result;
  const Vec<Dim> slip = nodes.free.col(a).cwiseProduct(Vec<Dim>(relative - normal.dot(relative) * normal));
  const double sliding = slip.norm(), sticking = sliding > most ? most / sliding : 1.0;
  if (slope) {
    Mat<Dim> tangential = nodes.free.col(a).asDiagonal() * (Mat<Dim>::Identity() - normal * normal.transpose());
    if (change > 0.0) *slope = direction * normal.transpose() / part;
    if (sticking < 1.0) {
      const Vec<Dim> unit = slip / sliding;
      tangential -= unit * (unit.transpose() * tangential).eval();
      if (change > 0.0) *slope -= gain * unit * normal.transpose();
    }
    *slope = mass * (*slope + sticking * tangential);
  }
  result.by_friction = -mass * sticking * slip;
  result.impulse = mass * change / part * direction + result.by_friction;
  return result;
}

/// Velocity and spin of a rigid body with a mass after contact with the nodes, by Newton's method for its momenta,
/// which are piecewise linear in both without friction. gaps: of all nodes.
template <int Dim> void RigidContact<Dim>::solve_motion(const World<Dim>& world, Rigid& rigid,
                                                        const std::vector<Gap<Dim>>& gaps, double dt) const {
  constexpr int n = freedoms<Dim>;
  using Motions = Vec<n>;
  Motions inertia, start;
  inertia << Vec<Dim>::Constant(rigid.body.mass), Spin<Dim>::Constant(rigid.body.inertia);
  inertia.template head<Dim>().array() *= rigid.body.free_axes().array();
  if (world.axisymmetric()) inertia[0] = 0.0;
  start << rigid.now.velocity, rigid.now.spin;
  double largest = 0.0;
  for (int iteration = 0; iteration < 50; ++iteration) {
    Motions q, residual;
    q << rigid.now.velocity, rigid.now.spin;
    residual = inertia.cwiseProduct(q - start);
    Mat<n> slope = inertia.asDiagonal();
    for (Index a = 0; a < world.nodes.size(); ++a) {
      Mat<Dim> of_node;
      const Vec<Dim> impulse = on_node(world, rigid, a, gaps[a], dt, 0.0, &of_node).impulse;
      if (impulse.isZero(0.0)) continue;
      const auto at = velocity_matrix<Dim>(world.nodes.x.col(a) - rigid.now.centre);
      residual += at.transpose() * impulse;
      slope += at.transpose() * of_node * at;
    }
    for (int i = 0; i < n; ++i)
      if (inertia[i] == 0.0) {
        slope.row(i).setZero();
        slope(i, i) = 1.0;
        residual[i] = 0.0;
      }
    const Motions step = slope.partialPivLu().solve(residual);
    q -= step;
    rigid.now.velocity = q.template head<Dim>();
    rigid.now.spin = q.template tail<n - Dim>();
    largest = std::max(largest, step.norm());
    if (step.norm() <= 1e-13 * largest) break;
  }
}

/// Counts the forces by which the scheme holds nodes off a wall. Returns by node the impulse over the mass that presses
/// it onto the wall already; empty: none, or it does not matter.
template <int Dim> Vector RigidContact<Dim>::count_wall_forces(World<Dim>& world, Rigid& rigid, double kick) const {
  const WallForces<Dim>* held = held_by_scheme(rigid);
  if (!held) return {};
  const Nodes<Dim>& nodes = world.nodes;
  Vector pressed;
  if (rigid.has_coulomb_friction()) pressed.setZero(nodes.size());
  const Vec<Dim> normal = world.walls[rigid.who.number].normal;
  for (std::size_t i = 0; i < held->nodes.size(); ++i) {
    const Index a = held->nodes[i];
    const Vec<Dim> force = held->forces[rigid.who.number].col(static_cast<Index>(i));
    if (!(nodes.mass[a] > 0.0) || force.isZero(0.0)) continue;
    rigid.add_reaction(world, nodes.body[a], nodes.x.col(a), kick * force);
    if (pressed.size() != 0) pressed[a] = std::max(0.0, kick * normal.dot(force) / nodes.mass[a]);
  }
  return pressed;
}

/// gaps: of all nodes; empty: not known yet.
template <int Dim> void RigidContact<Dim>::apply_to_nodes(World<Dim>& world, std::size_t k,
                                                          const std::vector<Gap<Dim>>& gaps, double kick, double dt) {
  Rigid& rigid = rigids_[k];
  Nodes<Dim>& nodes = world.nodes;
  const Vector pressed = count_wall_forces(world, rigid, kick);
  std::vector<std::vector<NodeImpulse>> found((nodes.size() + nodes_at_once - 1) / nodes_at_once);
  parallel_chunks(nodes.size(), nodes_at_once, [&](Index begin, Index end) {
    for (Index a = begin; a < end; ++a) {
      const Gap<Dim> gap = gaps.empty() ? gap_of_node(world, rigid, a) : gaps[a];
      const auto& [impulse, by_friction, friction] =
          on_node(world, rigid, a, gap, dt, pressed.size() != 0 ? pressed[a] : 0.0, nullptr);
      if (!rigid.friction.empty()) rigid.friction[a] = friction;
      if (!impulse.isZero(0.0)) found[begin / nodes_at_once].push_back({k, a, impulse, by_friction});
    }
  });
  for (const std::vector<NodeImpulse>& of_range : found)
    for (const NodeImpulse& on : of_range) {
      rigid.add_reaction(world, nodes.body[on.node], nodes.x.col(on.node), on.impulse);
      nodes.v.col(on.node) += on.impulse / nodes.mass[on.node];
      node_impulses_.push_back(on);
    }
}

template <int Dim> void RigidContact<Dim>::apply_impulses(World<Dim>& world, double kick, double dt) {
  node_impulses_.clear();
  for (Rigid& rigid : rigids_) {
    rigid.before = rigid.now;
    rigid.impulse.setZero();
    rigid.angular_impulse.setZero();
    prescribe_motion(world, rigid.body, world.time + 0.5 * dt, rigid.now);
    if (rigid.body.mass > 0.0 && !world.stands_still)
      rigid.now.velocity += kick * acceleration(world, rigid.body, rigid.now.centre, world.time);
    rigid.velocity_before = rigid.now.velocity;
  }
  apply_to_rigid_bodies(world, dt);
  for (std::size_t k = 0; k < rigids_.size(); ++k) {
    Rigid& rigid = rigids_[k];
    if (scheme_.nodes_persist()) {
      apply_to_surface(world, rigid, dt);
      if (rigid.has_coulomb_friction()) rigid.friction.resize(world.nodes.size());
      std::vector<Gap<Dim>> gaps;
      if (rigid.is_free() && !world.stands_still) {
        gaps.resize(world.nodes.size());
        parallel_for(world.nodes.size(), [&](Index a) { gaps[a] = gap_of_node(world, rigid, a); });
        solve_motion(world, rigid, gaps, dt);
      }
      apply_to_nodes(world, k, gaps, kick, dt);
    } else {
      apply_to_points(world, rigid, dt);
    }
    if (world.stands_still) continue;
    // Its momentum is that of the impulses, to rounding.
    const double radial = world.axisymmetric() ? 0.0 : 1.0;
    if (rigid.body.mass > 0.0) {
      rigid.now.velocity = rigid.velocity_before + rigid.body.free_axes().cwiseProduct(rigid.impulse) / rigid.body.mass;
      rigid.now.velocity[0] *= radial;
    }
    if (rigid.body.inertia > 0.0) rigid.now.spin = rigid.before.spin + rigid.angular_impulse / rigid.body.inertia;
  }
}

template <int Dim> void RigidContact<Dim>::finish_kick(World<Dim>& world, double kick, double dt) {
  if (rigids_.empty()) return;
  const Nodes<Dim>& nodes = world.nodes;
  double lost = 0.0, lost_by_friction = 0.0, prescribed = 0.0, gravity = 0.0, loads = 0.0;
  for (const auto& [k, node, impulse, by_friction] : node_impulses_) {
    const Vec<Dim> v = 0.5 * (nodes.v.col(node) + nodes.v_before.col(node)),
                   relative = v - rigids_[k].mean_velocity(nodes.x.col(node));
    lost -= (impulse - by_friction).dot(relative);
    lost_by_friction -= by_friction.dot(relative);
  }
  for (const auto& [on, of, at, normal, closing, impulse] : rigid_impulses_) {
    const Vec<Dim> relative = rigids_[on].mean_velocity(at) - rigids_[of].mean_velocity(at);
    const double along = impulse.dot(normal);
    lost -= along * normal.dot(relative);
    lost_by_friction -= (impulse - along * normal).dot(relative);
  }
  for (Rigid& rigid : rigids_) {
    auto& [body, who, now, before, near_points, point_impulses, pushed, travelled, friction, point_friction, impulse,
           angular_impulse, velocity_before] = rigid;
    const double work = -0.5 * impulse.dot(before.velocity + now.velocity),
                 angular_work = -0.5 * angular_impulse.dot(before.spin + now.spin);
    now.work += work + angular_work;
    if (body.mass == 0.0) prescribed += work;
    if (body.inertia == 0.0) prescribed += angular_work;
    gravity += dt * body.mass * world.mean_gravity(dt).dot(now.velocity);
    if (world.gravity_field && body.mass > 0.0) {
      const Vec<Dim> after = now.centre + dt * now.velocity;
      gravity += 0.5 * dt * body.mass *
                 (world.field_at(now.centre, world.time) + world.field_at(after, world.time + dt)).dot(now.velocity);
    }
    if (body.force) loads += 0.5 * dt * (body.force(world.time) + body.force(world.time + dt)).dot(now.velocity);
    now.force = impulse / kick;
    now.impulse += impulse;
    now.centre += dt * now.velocity;
    if (!now.spin.isZero(0.0)) now.rotation = rotation<Dim>(dt * now.spin) * now.rotation;
    travelled += now.spin.isZero(0.0) ? dt * now.velocity.norm() : world.surface_points.skin;
  }
  world.ledger.add_energy("contact", EnergyKind::loss, lost);
  world.ledger.add_energy("friction", EnergyKind::loss, lost_by_friction);
  world.ledger.add_energy("prescribed", EnergyKind::work, prescribed);
  if (loads != 0.0) world.ledger.add_energy("loads", EnergyKind::work, loads);
  if (gravity != 0.0) world.ledger.add_energy("gravity", EnergyKind::work, gravity);
}

template <int Dim> double RigidContact<Dim>::longest_step(const World<Dim>& world) const {
  if (rigids_.empty()) return Interaction<Dim>::longest_step(world);
  std::vector<Vec<Dim>> velocities;
  add_velocities(world, velocities);
  return step_of_half_spacing(world, velocities, scheme_.nodes_persist());
}

template <int Dim> void RigidContact<Dim>::add_velocities(const World<Dim>&, std::vector<Vec<Dim>>& velocities) const {
  for (const Rigid& rigid : rigids_) velocities.push_back(rigid.now.velocity);
}

template <int Dim> Vec<Dim> RigidContact<Dim>::velocity_by_half_a_step(const World<Dim>& world, const Rigid& rigid) {
  if (rigid.body.mass == 0.0) return Vec<Dim>::Zero();
  return 0.5 * world.last_step * acceleration(world, rigid.body, rigid.now.centre, world.time);
}

template <int Dim> void RigidContact<Dim>::tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const {
  // As of nodes (kinetic_energy): half a step of free fall later where there is no contact.
  for (const auto& rigid : rigids_) {
    const Vec<Dim> faster = velocity_by_half_a_step(world, rigid);
    const auto& [mass, inertia, now] = std::tie(rigid.body.mass, rigid.body.inertia, rigid.now);
    const Vec<Dim> momentum = mass * now.velocity;
    const Spin<Dim> angular_momentum = inertia * now.spin;
    const double falling = now.force.isZero(0.0) ? faster.squaredNorm() : 0.0;
    balance.energies.add_energy(
        "kinetic", EnergyKind::kinetic,
        0.5 * (mass * (now.velocity.dot(now.velocity + 2.0 * faster) + falling) + angular_momentum.dot(now.spin)));
    balance.momentum += momentum;
    balance.angular_momentum += moment_about_origin<Dim>(now.centre, momentum) + angular_momentum;
  }
}

template <int Dim> double RigidContact<Dim>::resting_energy(const World<Dim>& world) const {
  double result = 0.0;
  for (const auto& rigid : rigids_)
    if (!rigid.now.force.isZero(0.0))
      result += 0.5 * rigid.body.mass * velocity_by_half_a_step(world, rigid).squaredNorm();
  return result;
}

template <int Dim> void RigidContact<Dim>::begin_motions(const World<Dim>& world) {
  for (Rigid& rigid : rigids_) {
    begin_motion(world, rigid.body, world.time, rigid.now);
    rigid.now.impulse.setZero();
    rigid.now.work = 0.0;
    rigid.before = rigid.now;
  }
}

template <int Dim> Points<Dim> RigidContact<Dim>::wall_forces() const {
  Points<Dim> result(Dim, std::ranges::count_if(rigids_, &Rigid::is_wall));
  Index wall = 0;
  for (const Rigid& rigid : rigids_)
    if (rigid.is_wall()) result.col(wall++) = rigid.now.force;
  return result;
}

template <int Dim> std::vector<RigidState<Dim>> RigidContact<Dim>::rigid_bodies() const {
  std::vector<RigidState<Dim>> result;
  for (const Rigid& rigid : rigids_)
    if (!rigid.is_wall()) result.push_back(rigid.now);
  return result;
}

template <int Dim> void RigidContact<Dim>::nodes_inserted(const World<Dim>&, Index first, Index count) {
  for (Rigid& rigid : rigids_)
    if (!rigid.friction.empty()) rigid.friction.insert(rigid.friction.begin() + first, count, {});
}

template <int Dim> void RigidContact<Dim>::pack(Archive& archive) {
  std::uint64_t count = rigids_.size();
  archive(count);
  require(count == rigids_.size(), "the state is one of other walls and rigid bodies");
  for (Rigid& rigid : rigids_) {
    archive(rigid);
    rigid.pushed = {};  // near points may be others now
  }
  archive(x_searched_);
}

template class RigidContact<2>;
template class RigidContact<3>;

}  // namespace efree::internal
