// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and rigid bodies against points of the material, whose nodes come and go.
#include "efree/dynamics/contact/internal/least_energy.hpp"
#include "efree/dynamics/contact/internal/rigid_contact.hpp"

#include <algorithm>
#include <unordered_map>

namespace efree::internal {
/// Impulses one after the other, each such that its point stays outside and sticks as far as friction goes (projected
/// Gauss-Seidel: Moreau 1988; Jean 1999), from those of the step before.
template <int Dim> void RigidContact<Dim>::apply_to_points(World<Dim>& world, Rigid& rigid, double dt) {
  Nodes<Dim>& nodes = world.nodes;
  const double reach = 0.25 * (nodes.size() > 0 ? nodes.spacing[0] : 0.0) +
                       2.0 * dt * (scheme_.largest_speed(world) + rigid.now.velocity.norm());
  const ContactPoints<Dim> near = scheme_.find_contact_points(
      world, [&](const Vec<Dim>& at) { return gap_to<Dim>(rigid.body, rigid.now, at); }, reach);
  const std::size_t n = near.points().size();
  std::unordered_map<Index, Index> earlier;
  for (const Index number : std::exchange(rigid.near_points, {})) earlier.try_emplace(number, std::ssize(earlier));
  const Points<Dim> impulses_before =
      std::exchange(rigid.point_impulses, Points<Dim>::Zero(Dim, static_cast<Index>(n)));
  const std::vector<DelayedFriction> friction_before =
      std::exchange(rigid.point_friction, std::vector<DelayedFriction>(n));
  if (n == 0) return;
  const auto velocity_at = [&](std::size_t k) {
    Vec<Dim> v = Vec<Dim>::Zero();
    for (const auto& [a, N] : near.nodes_of(k)) v += N * nodes.v.col(a);
    return v;
  };
  const Vec<Dim> inverse_mass = (rigid.body.mass > 0.0 ? 1.0 / rigid.body.mass : 0.0) * rigid.body.free_axes();
  const double inverse_inertia = rigid.body.inertia > 0.0 ? 1.0 / rigid.body.inertia : 0.0;
  const auto apply = [&](std::size_t k, const Vec<Dim>& impulse) {
    for (const auto& [a, N] : near.nodes_of(k))
      nodes.v.col(a) += N / nodes.mass[a] * nodes.free.col(a).cwiseProduct(impulse);
    rigid.now.velocity -= inverse_mass.cwiseProduct(impulse);
    rigid.now.spin -= inverse_inertia * moment_about_origin<Dim>(near.points()[k].at - rigid.now.centre, impulse);
  };
  // Of each point: velocity by an impulse of one along the normal, and the least change of the gap per time.
  std::vector<double> mobility(n), closing(n);
  for (std::size_t k = 0; k < n; ++k) {
    const auto& [number, at, gap, begin] = near.points()[k];
    for (const auto& [a, N] : near.nodes_of(k))
      mobility[k] += N * N / nodes.mass[a] * nodes.free.col(a).cwiseProduct(gap.normal).squaredNorm();
    const double lever = moment_about_origin<Dim>(at - rigid.now.centre, gap.normal).squaredNorm();
    mobility[k] += inverse_mass.dot(gap.normal.cwiseAbs2()) + inverse_inertia * lever;
    // What overlaps is not pushed out, which would make it fast: where a body ends is known to a part of a cell.
    closing[k] = std::max(gap.gap, 0.0) / dt;
    rigid.near_points.push_back(number);
    const auto place = earlier.find(number);
    if (place == earlier.end()) continue;
    // The normal has changed little.
    rigid.point_impulses.col(static_cast<Index>(k)) = impulses_before.col(place->second);
    rigid.point_friction[k] = friction_before[place->second];
    apply(k, rigid.point_impulses.col(static_cast<Index>(k)));
  }
  // The largest impulse of friction by that along the normal; what is left of it is for later steps.
  const auto friction_at = [&](std::size_t k, double normal) {
    DelayedFriction friction = rigid.point_friction[k];
    friction.press(rigid.body.friction * normal, dt, longest_delay(world));
    return friction;
  };
  const auto most_friction = [&](std::size_t k, double normal) {
    if (rigid.has_coulomb_friction()) return friction_at(k, normal).limit();
    return normal > 0.0 && rigid.body.friction > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
  };
  double largest = 0.0;
  const IterationEnd end = iteration_end(world, sweeps_of_points);
  for (int sweep = 0; sweep < end.most; ++sweep) {
    double change = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      if (!(mobility[k] > 0.0)) continue;
      const auto& [number, at, gap, begin] = near.points()[k];
      auto impulse = rigid.point_impulses.col(static_cast<Index>(k));
      const Vec<Dim> relative = velocity_at(k) - velocity_of<Dim>(rigid.now, at), before = impulse;
      const double approach = relative.dot(gap.normal) + closing[k];
      const double normal = std::max(0.0, before.dot(gap.normal) - approach / mobility[k]);
      Vec<Dim> tangential = Vec<Dim>::Zero();
      if (const double most = most_friction(k, normal); most > 0.0) {
        const Vec<Dim> wanted = before - relative / mobility[k];
        tangential = wanted - wanted.dot(gap.normal) * gap.normal;
        const double size = tangential.norm();
        if (size > most) tangential *= most / size;
      }
      impulse = normal * gap.normal + tangential;
      const Vec<Dim> more = impulse - before;
      largest = std::max(largest, -approach);
      change = std::max(change, mobility[k] * more.norm());
      if (!more.isZero(0.0)) apply(k, more);
    }
    if (change <= end.tolerance * largest) break;
  }
  double lost = 0.0, lost_by_friction = 0.0, held = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    const auto& [number, at, gap, begin] = near.points()[k];
    const Vec<Dim> impulse = rigid.point_impulses.col(static_cast<Index>(k));
    const double normal = impulse.dot(gap.normal);
    if (rigid.has_coulomb_friction()) {
      rigid.point_friction[k] = friction_at(k, normal);
      rigid.point_friction[k].grant();
    }
    if (impulse.isZero(0.0)) continue;
    rigid.add_reaction(world, nodes.body[near.nodes_of(k).front().first], at, impulse);
    Vec<Dim> relative = -rigid.mean_velocity(at);
    for (const auto& [a, N] : near.nodes_of(k)) {
      // Supports take what would change velocities that are prescribed.
      const Vec<Dim> on_support = N * impulse - N * nodes.free.col(a).cwiseProduct(impulse);
      held -= on_support.dot(nodes.v.col(a));
      relative += 0.5 * N * (nodes.v.col(a) + nodes.v_before.col(a));
      lost += 0.5 * on_support.dot(nodes.v_before.col(a) - nodes.v.col(a));
    }
    lost -= normal * gap.normal.dot(relative);
    lost_by_friction -= (impulse - normal * gap.normal).dot(relative);
  }
  world.ledger.add_energy("prescribed", EnergyKind::work, held);
  world.ledger.add_energy("contact", EnergyKind::loss, lost);
  world.ledger.add_energy("friction", EnergyKind::loss, lost_by_friction);
}

template void RigidContact<2>::apply_to_points(World<2>&, Rigid&, double);
template void RigidContact<3>::apply_to_points(World<3>&, Rigid&, double);

}  // namespace efree::internal
