// SPDX-License-Identifier: GPL-3.0-or-later
/// Rigid bodies against each other.
#include "efree/dynamics/contact/internal/rigid_contact.hpp"

namespace efree::internal {
namespace {

/// Sweeps over all contacts end when none changes a velocity by more than this part of the largest.
constexpr double rigid_tolerance = 1e-9;
constexpr int most_rigid_sweeps = 200;

/// Coulomb's coefficient of two rigid bodies.
template <int Dim> double friction_between(const RigidBody<Dim>& one, const RigidBody<Dim>& other) {
  const double least = std::min(one.friction, other.friction), most = std::max(one.friction, other.friction);
  return least > 0.0 ? std::sqrt(least) * std::sqrt(most) : 0.0;
}

}  // namespace

/// Corners of rigid bodies that may come into contact with another one in this step.
template <int Dim> void RigidContact<Dim>::find_rigid_pairs(const World<Dim>& world, double dt) {
  rigid_impulses_.clear();
  for (std::size_t i = 0; i < rigids_.size(); ++i) {
    const Rigid& on = rigids_[i];
    for (Index c = 0; c < on.body.corners.cols(); ++c) {
      const Vec<Dim> at = on.now.centre + on.now.rotation * (on.body.corners.col(c) - on.body.centre);
      for (std::size_t j = 0; j < rigids_.size(); ++j) {
        const Rigid& of = rigids_[j];
        // Two round ones meet once.
        const bool is_twice = on.body.round > 0.0 && of.body.round > 0.0 && j < i;
        if (i == j || is_twice || !(on.is_free() || of.is_free())) continue;
        const Gap<Dim> gap = gap_to<Dim>(of.body, of.now, at);
        const double open = gap.gap - on.body.round;
        const Vec<Dim> contact = at - (on.body.round + 0.5 * open) * gap.normal;
        const Vec<Dim> relative = velocity_of<Dim>(on.now, contact) - velocity_of<Dim>(of.now, contact);
        // What overlaps is moved apart within some stable steps.
        const double closing = open / (open < 0.0 ? 10.0 * std::max(dt, world.stable_step) : dt);
        if (gap.normal.dot(relative) + closing < 0.0 || open < 0.0)
          rigid_impulses_.push_back({i, j, contact, gap.normal, closing});
      }
    }
  }
}

/// Impulses one after the other, each such that its corner stays outside and sticks as far as friction goes (projected
/// Gauss-Seidel: Moreau 1988; Jean 1999).
template <int Dim> void RigidContact<Dim>::apply_to_rigid_bodies(World<Dim>& world, double dt) {
  find_rigid_pairs(world, dt);
  double largest = 0.0;
  for (int sweep = 0; sweep < most_rigid_sweeps && !rigid_impulses_.empty(); ++sweep) {
    double change = 0.0;
    for (auto& [on, of, at, normal, closing, impulse] : rigid_impulses_) {
      Rigid &one = rigids_[on], &other = rigids_[of];
      const Vec<Dim> relative = velocity_of<Dim>(one.now, at) - velocity_of<Dim>(other.now, at);
      const auto mobility = [&](const Vec<Dim>& along) {
        return along.dot(one.mobility_times(at - one.now.centre, along)) +
               along.dot(other.mobility_times(at - other.now.centre, along));
      };
      const double by_normal = mobility(normal);
      if (!(by_normal > 0.0)) continue;
      const Vec<Dim> before = impulse;
      const double pressed = std::max(0.0, before.dot(normal) - (relative.dot(normal) + closing) / by_normal);
      const Vec<Dim> slip = relative - relative.dot(normal) * normal;
      const double sliding = slip.norm(), most = pressed > 0.0 ? friction_between(one.body, other.body) * pressed : 0.0;
      Vec<Dim> along = before - before.dot(normal) * normal;
      if (sliding > 0.0) {
        const Vec<Dim> direction = slip / sliding;
        if (const double of_slip = mobility(direction); of_slip > 0.0) along -= sliding / of_slip * direction;
      }
      if (const double size = along.norm(); size > most) along *= most > 0.0 ? most / size : 0.0;
      impulse = pressed * normal + along;
      const Vec<Dim> more = impulse - before;
      one.push(at, more);
      other.push(at, -more);
      largest = std::max(largest, relative.norm());
      change = std::max(change, by_normal * more.norm());
    }
    if (change <= rigid_tolerance * largest) break;
  }
  for (const auto& [on, of, at, normal, closing, impulse] : rigid_impulses_) {
    if (impulse.isZero(0.0)) continue;
    rigids_[on].add_impulse(at, impulse);
    rigids_[of].add_impulse(at, -impulse);
    world.contacts.add(rigids_[on].who, rigids_[of].who, at, impulse);
  }
}

template void RigidContact<2>::find_rigid_pairs(const World<2>&, double);
template void RigidContact<3>::find_rigid_pairs(const World<3>&, double);
template void RigidContact<2>::apply_to_rigid_bodies(World<2>&, double);
template void RigidContact<3>::apply_to_rigid_bodies(World<3>&, double);

}  // namespace efree::internal
