// SPDX-License-Identifier: GPL-3.0-or-later
/// What acts on nodes besides the stresses of their bodies: walls and rigid bodies, contact, gas, springs.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/dynamics/state.hpp"

#include <limits>

namespace efree {

/// A part of a run that acts on nodes. In every step: impulses on the velocities, in the order in which interactions
/// were added; then `finish_kick` of all; nodes move; and after the internal forces `add_forces`. Energies go to the
/// world's ledger, or are tallied.
template <int Dim> class Interaction {
 public:
  virtual ~Interaction() = default;

  /// Changes nodes.v by impulses; kick: how long forces act on velocities, dt: how long the nodes move with these.
  virtual void apply_impulses(World<Dim>&, double /*kick*/, double /*dt*/) {}
  /// Velocities are final (v; v_before half a step earlier): works, and what moves with them.
  virtual void finish_kick(World<Dim>&, double /*kick*/, double /*dt*/) {}
  /// Adds to nodes.force where the nodes are now.
  virtual void add_forces(World<Dim>&) {}
  /// Adds its stiffness times a small displacement of the nodes, for the stable time step.
  virtual void add_stiffness(const World<Dim>&, const Points<Dim>& /*displacement*/, Points<Dim>& /*force*/) const {}
  /// No less than the largest squared angular frequency of its stiffness with the masses of the nodes [1/time^2], for
  /// schemes that know their stable step.
  virtual double squared_frequency(const World<Dim>&) const { return 0.0; }
  /// Whether it keeps bodies from passing through each other.
  virtual bool is_contact() const { return false; }
  /// Longest step that it bears.
  virtual double longest_step(const World<Dim>&) const { return std::numeric_limits<double>::infinity(); }
  /// Velocities of things that nodes may meet.
  virtual void add_velocities(const World<Dim>&, std::vector<Vec<Dim>>&) const {}
  /// Every 64 steps.
  virtual void inspect(World<Dim>&) {}
  /// Adds energies and momenta that it has now.
  virtual void tally(const World<Dim>&, EnergyBalance<Dim>&) const {}
  /// Nodes `first` and following are new; those that had these numbers come after them.
  virtual void nodes_inserted(const World<Dim>&, Index /*first*/, Index /*count*/) {}
  /// A node moves with another from now on, and has no mass.
  virtual void node_merged(const World<Dim>&, Index /*node*/, Index /*with*/) {}
  /// An edge between two nodes was split by a new one in its middle.
  virtual void edge_split(World<Dim>&, Index /*a*/, Index /*b*/, Index /*middle*/) {}
  /// Its state in a checkpoint.
  virtual void pack(Archive&) {}
};

/// The step in which no node moves further than half its spacing, and nothing with one of the other velocities further
/// than half the smallest spacing: points would be inverted where nodes are stopped while others move on.
/// moving: whether nodes stay with the material; else only the others count.
template <int Dim>
double step_of_half_spacing(const World<Dim>& world, const std::vector<Vec<Dim>>& others = {}, bool moving = true) {
  constexpr Index at_once = 1024;
  const Nodes<Dim>& nodes = world.nodes;
  const double none = std::numeric_limits<double>::infinity();
  std::vector<std::pair<double, double>> of_ranges((nodes.size() + at_once - 1) / at_once, {none, none});
  parallel_chunks(nodes.size(), at_once, [&](Index begin, Index end) {
    auto& [step, spacing] = of_ranges[begin / at_once];
    for (Index a = begin; a < end; ++a) {
      if (nodes.follows(a) || !(nodes.mass[a] > 0.0)) continue;
      spacing = std::min(spacing, nodes.spacing[a]);
      if (const double speed = moving ? nodes.v.col(a).norm() : 0.0; speed > 0.0)
        step = std::min(step, 0.5 * nodes.spacing[a] / speed);
    }
  });
  double longest = none, smallest = none;
  for (const auto& [step, spacing] : of_ranges) {
    longest = std::min(longest, step);
    smallest = std::min(smallest, spacing);
  }
  for (const Vec<Dim>& velocity : others)
    if (const double speed = velocity.norm(); speed > 0.0) longest = std::min(longest, 0.5 * smallest / speed);
  return longest;
}

}  // namespace efree
