// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and rigid bodies, which nodes and surface points of deformable bodies do not enter.
#pragma once

#include "efree/dynamics/contact/internal/friction.hpp"
#include "efree/dynamics/contact/internal/pushed_points.hpp"
#include "efree/dynamics/contact/rigid_body.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/dynamics/scheme.hpp"

namespace efree::internal {

/// Contact with walls and rigid bodies by impulses, one of them after the other.
template <int Dim> class RigidContact : public Interaction<Dim> {
 public:
  /// The scheme must outlive it.
  explicit RigidContact(const Scheme<Dim>& scheme) : scheme_(scheme) {}
  /// Throws InputError for numbers that make no sense, and for a mass where bodies have surface points.
  void add(const World<Dim>& world, const RigidBody<Dim>& body, bool is_wall);
  /// All have their velocities of the start again, where they are, and no impulses and work.
  void begin_motions(const World<Dim>& world);
  /// Force of the bodies on each wall in the last step, in the order they were added.
  Points<Dim> wall_forces() const;
  /// Of all that are no walls, in the order they were added.
  std::vector<RigidState<Dim>> rigid_bodies() const;

  void apply_impulses(World<Dim>& world, double kick, double dt) override;
  void finish_kick(World<Dim>& world, double kick, double dt) override;
  double longest_step(const World<Dim>& world) const override;
  void add_velocities(const World<Dim>& world, std::vector<Vec<Dim>>& velocities) const override;
  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override;
  /// As KineticEnergy::resting, of rigid bodies with a mass that are in contact.
  double resting_energy(const World<Dim>& world) const;
  /// Throws InputError for the state of another number of walls and rigid bodies.
  void nodes_inserted(const World<Dim>& world, Index first, Index count) override;
  void pack(Archive& archive) override;

 private:
  /// How impulses move the near points of a rigid body, as far as it has been found.
  struct Pushed {
    std::optional<PushedPoints<1>> along_normal{};
    std::optional<PushedPoints<Dim>> along_axes{};
    Vec<Dim> normal = Vec<Dim>::Zero();  ///< where it is flat
  };
  /// A wall or rigid body in the run.
  struct Rigid {
    RigidBody<Dim> body;
    ContactPartner who;                ///< which of World::walls, or of the rigid bodies, it is
    RigidState<Dim> now, before;       ///< before: a step ago
    std::vector<Index> near_points{};  ///< surface points that may come into contact soon, ascending
    Points<Dim> point_impulses{};      ///< on these in the last step
    Pushed pushed{};
    double travelled = 0.0;                         ///< since these were found [length]
    std::vector<DelayedFriction> friction{};        ///< by node; empty: none
    std::vector<DelayedFriction> point_friction{};  ///< by near point
    Vec<Dim> impulse = Vec<Dim>::Zero();            ///< of the bodies on it in this step
    Spin<Dim> angular_impulse = Spin<Dim>::Zero();  ///< likewise, about the centre
    Vec<Dim> velocity_before = Vec<Dim>::Zero();    ///< without contact, in this step

    bool is_wall() const { return who.kind == ContactPartner::Kind::wall; }
    bool has_coulomb_friction() const { return body.friction > 0.0 && std::isfinite(body.friction); }
    bool is_free() const { return body.is_free(); }
    /// Counts an impulse on a body at a position.
    void add_reaction(World<Dim>& world, Index to, const Vec<Dim>& at, const Vec<Dim>& on_body) {
      world.contacts.add(body_partner(to), who, at, on_body);
      add_impulse(at, -on_body);
    }
    /// Counts an impulse on it at a position.
    void add_impulse(const Vec<Dim>& at, const Vec<Dim>& on_it) {
      impulse += on_it;
      angular_impulse += moment_about_origin<Dim>(at - now.centre, on_it);
    }
    /// Velocity of the place of an impulse of one on it.
    Vec<Dim> mobility_times(const Vec<Dim>& arm, const Vec<Dim>& on_it) const {
      Vec<Dim> result = Vec<Dim>::Zero();
      if (body.mass > 0.0) result += body.free_axes().cwiseProduct(on_it) / body.mass;
      if (body.inertia > 0.0)
        result += rotation_velocity<Dim>(Spin<Dim>(moment_about_origin<Dim>(arm, on_it) / body.inertia), arm);
      return result;
    }
    /// Its velocities change by that impulse.
    void push(const Vec<Dim>& at, const Vec<Dim>& on_it) {
      if (body.mass > 0.0) now.velocity += body.free_axes().cwiseProduct(on_it) / body.mass;
      if (body.inertia > 0.0) now.spin += moment_about_origin<Dim>(at - now.centre, on_it) / body.inertia;
    }
    /// Its velocity at a position, the mean of a step ago and now.
    Vec<Dim> mean_velocity(const Vec<Dim>& at) const {
      return 0.5 * (velocity_of<Dim>(before, at) + velocity_of<Dim>(now, at));
    }
    // Shapes and prescribed motions are given again by whoever resumes a run; the rest begins with every step.
    friend auto fields(Rigid& of) {
      auto& [body, who, now, before, near_points, point_impulses, pushed, travelled, friction, point_friction, impulse,
             angular_impulse, velocity_before] = of;
      return std::tie(now, near_points, point_impulses, travelled, friction, point_friction);
    }
  };
  /// What a rigid body does to a node in a step.
  struct OnNode {
    Vec<Dim> impulse = Vec<Dim>::Zero();
    Vec<Dim> by_friction = Vec<Dim>::Zero();  ///< the part of it along the surface
    DelayedFriction friction{};               ///< after it
  };
  /// An impulse on a rigid body by another one.
  struct RigidImpulse {
    std::size_t on, of;
    Vec<Dim> at, normal;  ///< outwards of `of`
    double closing;       ///< velocity along the normal at which the gap closes in the step
    Vec<Dim> impulse = Vec<Dim>::Zero();
  };
  /// An impulse on a node.
  struct NodeImpulse {
    std::size_t rigid;  ///< that it is of
    Index node;
    Vec<Dim> impulse, by_friction;
  };

  const WallForces<Dim>* held_by_scheme(const Rigid& rigid) const;
  /// What gravity and its own force add to the velocity of one with a mass in half a step.
  static Vec<Dim> velocity_by_half_a_step(const World<Dim>& world, const Rigid& rigid);
  Gap<Dim> gap_of_node(const World<Dim>& world, const Rigid& rigid, Index a) const;
  OnNode on_node(const World<Dim>& world, const Rigid& rigid, Index a, const Gap<Dim>& of, double dt, double pressed,
                 Mat<Dim>* slope) const;
  void solve_motion(const World<Dim>& world, Rigid& rigid, const std::vector<Gap<Dim>>& gaps, double dt) const;
  Vector count_wall_forces(World<Dim>& world, Rigid& rigid, double kick) const;
  void apply_to_nodes(World<Dim>& world, std::size_t k, const std::vector<Gap<Dim>>& gaps, double kick, double dt);
  // Rigid bodies (rigid_pairs.cpp).
  void find_rigid_pairs(const World<Dim>& world, double dt);
  void apply_to_rigid_bodies(World<Dim>& world, double dt);
  // Points of the material (point_impulses.cpp).
  void apply_to_points(World<Dim>& world, Rigid& rigid, double dt);
  // Surface points (surface_impulses.cpp).
  void find_near_points(const World<Dim>& world);
  Points<1> find_point_friction(const World<Dim>& world, Rigid& rigid, const Points<1>& normal, double dt) const;
  bool find_point_impulses(const World<Dim>& world, Rigid& rigid, double dt, Points<Dim>& by_friction);
  void apply_to_surface(World<Dim>& world, Rigid& rigid, double dt);

  const Scheme<Dim>& scheme_;
  std::vector<Rigid> rigids_;
  Points<Dim> x_searched_;         ///< positions of the nodes when near points were found; empty: not yet
  InverseMass<Dim> inverse_mass_;  ///< where surface points are in contact
  // In this step.
  std::vector<NodeImpulse> node_impulses_;
  std::vector<RigidImpulse> rigid_impulses_;
};

}  // namespace efree::internal
