// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads: gravity, prescribed velocities, gas in cavities.
#pragma once

#include "efree/dynamics/contact/cavity.hpp"
#include "efree/dynamics/interaction.hpp"

namespace efree::internal {

/// World::gravity and World::gravity_field on the nodes. On rigid bodies they act in RigidContact.
template <int Dim> class Gravity : public Interaction<Dim> {
 public:
  /// Sets World::gravity_field; nodes.force changes at once. Empty: none. Throws InputError where it is not finite.
  void set_field(World<Dim>& world, GravityField<Dim> field);

  void add_forces(World<Dim>& world) override;
  void finish_kick(World<Dim>& world, double kick, double dt) override;
  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override;
  void pack(Archive& archive) override { archive(by_field_); }

 private:
  Points<Dim> by_field_;  ///< Dim x N, forces by World::gravity_field; empty: none
};

/// Sets the velocities of World::prescribed. What is prescribed at both ends of an edge that is split is prescribed in
/// its middle: call World::find_free_axes afterwards.
template <int Dim> std::unique_ptr<Interaction<Dim>> prescribed_velocities();

/// Facets with both ends of an edge become two, with its middle.
template <int Dim> void split_facets(Facets<Dim>& facets, Index a, Index b, Index middle);

/// Forces of gas in cavities on the nodes of their surfaces.
template <int Dim> class Cavities : public Interaction<Dim> {
 public:
  /// Adds the forces of all cavities to nodes.force at once. Throws InputError for facets that are not closed or
  /// enclose nothing.
  void add(World<Dim>& world, const GasCavity<Dim>& cavity);

  void add_forces(World<Dim>& world) override;
  void tally(const World<Dim>& world, EnergyBalance<Dim>& balance) const override;
  void nodes_inserted(const World<Dim>& world, Index first, Index count) override;
  void node_merged(const World<Dim>& world, Index node, Index with) override;
  /// Facets with both ends of the edge are split in two.
  void edge_split(World<Dim>& world, Index a, Index b, Index middle) override;
  void pack(Archive& archive) override { archive(cavities_); }

 private:
  struct Cavity {
    GasCavity<Dim> gas;
    double volume;        ///< at the start; negative if facets are oriented inwards
    double stored = 0.0;  ///< energy of the gas, less that at the start
    friend auto fields(Cavity& of) {
      auto& [gas, volume, stored] = of;
      return std::tie(gas, volume, stored);
    }
  };
  std::vector<Cavity> cavities_;
};

}  // namespace efree::internal
