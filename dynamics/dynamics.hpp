// SPDX-License-Identifier: GPL-3.0-or-later
/// Explicit dynamics: leapfrog in time for deformable bodies, by any scheme.
#pragma once

#include "efree/dynamics/contact/cavity.hpp"
#include "efree/dynamics/contact/overlap.hpp"
#include "efree/dynamics/contact/rigid_body.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/scheme.hpp"

namespace efree {

/// A run of explicit dynamics. Nodes carry positions and velocities, material points deformation gradients, stress and
/// history. Momenta are conserved; results are bitwise the same on any number of threads.
template <int Dim> class Dynamics {
 public:
  /// scheme: such as otm<Dim>() or total_lagrangian<Dim>(). Throws InputError for bodies or options that make no sense
  /// and NumericalError for a point that has no shape functions.
  Dynamics(std::vector<DeformableBody<Dim>> bodies, std::unique_ptr<Scheme<Dim>> scheme,
           const DynamicsOptions& options = {});
  Dynamics(Dynamics&&) noexcept;
  Dynamics& operator=(Dynamics&&) noexcept;
  ~Dynamics();

  /// The state, such as interactions and schemes have it.
  const World<Dim>& world() const;
  /// Nodes are numbered body by body; points too, and both in the order of their body.
  Index num_nodes() const { return world().nodes.size(); }
  Index num_points() const { return world().num_points(); }
  Index num_bodies() const { return world().num_bodies(); }
  const Material& material(Index body) const { return *world().bodies.at(body).material; }
  /// body = number of bodies: one past the last of all.
  Index first_node(Index body) const { return world().first_node.at(body); }
  Index first_point(Index body) const { return world().first_point.at(body); }

  void add_wall(const Wall<Dim>& wall);
  /// Throws InputError for numbers that make no sense, and for a mass where bodies have surfaces of their own.
  void add_rigid_body(const RigidBody<Dim>& body);
  /// Throws InputError for facets that do not close or enclose nothing.
  void add_cavity(const GasCavity<Dim>& cavity);
  /// Acts after all others, with its forces from now on.
  void add_interaction(std::unique_ptr<Interaction<Dim>> interaction);
  /// The node's velocity along an axis is prescribed from now on.
  void prescribe(Index node, int axis, double velocity);
  /// Likewise of all nodes whose positions are there, now and whenever the scheme makes new ones.
  void prescribe(std::function<bool(const Vec<Dim>&)> where, int axis, double velocity);
  /// Likewise of material points, ascending, each with its velocity, where the scheme's nodes do not stay with the
  /// material: of nodes that have half of their mass and more from these. Throws InputError for other schemes.
  void prescribe_points(std::vector<Index> points, int axis, const Vector& velocity);
  /// Velocities of nodes, or points, that depend on the time: by the positions that these have now, in every step at
  /// its middle. Throws InputError as the above, and for a law that is empty; what the law throws ends the step.
  /// is_displacement: the law is that of displacements instead, which these then have exactly after every step.
  void prescribe(const std::vector<Index>& nodes, int axis, VelocityLaw<Dim> law, bool is_displacement = false);
  void prescribe_points(std::vector<Index> points, int axis, VelocityLaw<Dim> law, bool is_displacement = false);
  /// Bodies, and rigid bodies that have a mass, get this force per mass from now on [length/time^2], such as gravity,
  /// in place of the one before. Throws InputError for what is no number, and in an axisymmetric section for one along
  /// the radius.
  void set_gravity(const Vec<Dim>& acceleration);
  /// Likewise by the time.
  void set_gravity_law(std::function<Vec<Dim>(double time)> acceleration);
  /// Likewise by position and time: of nodes (mpm: those of the grid, up to two cells outside of bodies) and of the
  /// centres of rigid bodies, where they are at the time. In an axisymmetric section along the radius, too. Throws
  /// InputError where it is empty or not finite, in steps as well.
  void set_gravity_field(GravityField<Dim> acceleration);

  /// The point bears no stress from now on: its mass stays with its nodes, with their velocities, and the energy stored
  /// in it is lost ("fracture"). Nothing happens to a point that is eroded.
  void erode(Index point);
  bool is_eroded(Index point) const {
    const auto [chunk, p] = world().place_of_point.at(point);
    return world().chunks[chunk].is_eroded(p);
  }
  /// M, energy release rates of the points now [stress length]; 0 where a body has no toughness and at points that are
  /// eroded or not under tension.
  Vector release_rates() const;
  /// M, 1 where a point is eroded; else the sum of FractureCriteria::strain so far, or 0.
  Vector damage() const;
  /// Points that are inside another body by half a spacing and more, ascending, if bodies are in contact: contact does
  /// not push those out that are there at the start.
  std::vector<Index> points_in_others() const;
  /// The node that is deepest inside another body, where contact keeps bodies apart by their facets.
  Overlap deepest_overlap() const;
  /// Points that the last step would have inverted: they are as they were, and get other shape functions in the next.
  Index num_inverted() const;

  /// One step, of at most this; returns its length. Throws NumericalError, with point, place and time, where it cannot
  /// go on, and where energy is lost or gained (DynamicsOptions::imbalance).
  double step(double at_most = std::numeric_limits<double>::infinity());
  /// Before the first step: bodies come to rest under the loads of time 0, by kinetic damping, until `residual` is so
  /// small. Prescribed motions wait meanwhile; time and steps are 0 again afterwards, and so are velocities, but for
  /// those of a rotation about the origin with `spin`, whose centrifugal forces the bodies then bear. `look` is called
  /// now and then with the residual, and may throw. Throws NumericalError after `most_steps`, and as step().
  void come_to_rest(double residual, Index most_steps, const Spin<Dim>& spin = Spin<Dim>::Zero(),
                    const std::function<void(double)>& look = {});
  /// Sets velocities of nodes (Dim x N) before the first step, such as initial ones after come_to_rest.
  void set_velocities(const Points<Dim>& velocities);
  /// Before walls, rigid bodies, loads and supports are added: positions, deformations, stresses, histories and, with
  /// `velocities`, velocities become those of a run with these bodies and this scheme, whose state() this is. Time,
  /// steps and energies begin with 0, and what the bodies have stored is there at the start. Masses are those of this
  /// run's mass scaling. Throws InputError for another scheme, plane or number of bodies, for other nodes, points or
  /// materials, and for bytes that are damaged; it names bodies by `names`, if there are any.
  void begin_from(std::string_view state, bool velocities = true, const std::vector<std::string>& names = {});
  /// Before the first step: points get the elastic deformation, without rotation, that bears this Cauchy stress, by
  /// body and position; without a value they stay as they are. Positions and masses stay, and so do volumes: those of
  /// the reference configuration are these over J. Points of a pressure patch share its mean pressure. Throws
  /// InputError, with place and stress, where a material does not bear it, or flows.
  void set_stresses(const std::function<std::optional<Mat<3>>(Index body, const Vec<Dim>& x)>& stress);
  /// How far bodies at rest are from equilibrium: the largest force on a node that is free, over the largest of
  /// stresses, of each point without regard to its neighbours; or the sum of the former over the weight if that is
  /// larger. Nodes `in_contact` bear forces of contact, too, and are left out.
  double imbalance(const std::vector<Index>& in_contact = {}) const;
  /// The most that a step may be where so much time is left: the last two steps share the rest, so that none is tiny.
  double step_towards(double left) const {
    return left > stable_step() && left < 2.0 * stable_step() ? 0.5 * left : left;
  }
  /// Steps until this time. The last step is cut to end there.
  void run(double until);

  /// All that changes in a run, as bytes: what `restore` goes on from to bitwise the same results.
  std::string state() const;
  /// Goes on from there. Throws InputError for bytes that are not of bodies, options and walls such as these.
  void restore(std::string_view state);

  double time() const { return world().time; }
  Index steps() const { return world().steps - world().steps_of_earlier_run; }
  double stable_step() const { return world().stable_step; }  ///< the next one's bound
  std::string scheme() const;                                 ///< its name
  bool nodes_persist() const;  ///< whether nodes stay with the material (Scheme::nodes_persist)
  const Points<Dim>& nodes() const { return world().nodes.x; }  ///< Dim x N, positions
  Points<Dim> velocities() const { return world().nodes.v; }    ///< Dim x N, half a step ago
  const Vector& masses() const { return world().nodes.mass; }   ///< N, lumped
  Points<Dim> points() const;                                   ///< Dim x M, positions
  Points<Dim> point_velocities() const;                         ///< Dim x M, half a step ago
  Tensors deformation() const;       ///< 9 x M, F; of metals that have flown far up to plastic flow (theory.md)
  Tensors cauchy_stress() const;     ///< 9 x M
  Matrix history(Index body) const;  ///< of the material x points of the body
  /// How far from rest: the norm of mass times acceleration of the nodes in the last step, over that of the forces of
  /// stresses, of each point without regard to its neighbours; or the root of the kinetic over the stored energy if
  /// that is larger. Infinity before the first step and where all velocities are zero.
  double residual() const;
  /// By body: masses with those of mass scaling apart.
  std::vector<BodyMass> body_masses() const;
  /// Of mass scaling so far; empty in runs of fewer than three times that a wave takes through a body.
  AddedInertia added_inertia() const;
  EnergyBalance<Dim> balance() const;
  EnergyWatch energy() const;  ///< now, and at its worst so far; from the first step on
  /// Counts and times so far, by name.
  Ledger ledger() const;
  std::int64_t count(std::string_view name) const { return ledger().count(name); }
  /// Impulses of contact so far between all pairs of bodies, rigid bodies and walls that were in contact: by body, then
  /// by partner.
  const std::vector<ContactImpulse<Dim>>& contacts() const { return world().contacts.all(); }
  /// Force of the bodies on each wall in the last step, in the order they were added.
  Points<Dim> wall_forces() const;
  /// In the order they were added.
  std::vector<RigidState<Dim>> rigid_bodies() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace efree
