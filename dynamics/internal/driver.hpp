// SPDX-License-Identifier: GPL-3.0-or-later
/// How a run goes on, behind Dynamics.
#pragma once

#include "efree/dynamics/contact/internal/rigid_contact.hpp"
#include "efree/dynamics/fracture/internal/fracture.hpp"
#include "efree/dynamics/internal/earlier_state.hpp"
#include "efree/dynamics/internal/initial_stress.hpp"
#include "efree/dynamics/internal/kinetic_energy.hpp"
#include "efree/dynamics/internal/loads.hpp"
#include "efree/dynamics/internal/mass_scaling.hpp"
#include "efree/dynamics/internal/stable_step.hpp"

#include <memory>
#include <vector>

namespace efree::internal {

/// The state, the scheme and the interactions, in the order in which they act.
template <int Dim> struct Driver {
  World<Dim> world;
  std::unique_ptr<Scheme<Dim>> scheme;
  StableStep<Dim> stable;
  Fracture<Dim> fracture;
  EnergyWatch watch;
  StateIdentity identity;              ///< of the bodies at the start
  InertiaSampling<Dim> inertia;        ///< of mass scaling
  std::vector<char> resting;           ///< by body, of the last step: find_resting_bodies
  std::vector<double> start_shares;    ///< by body: find_start_shares; empty: not yet
  bool lacks_walls = false;            ///< forces are of a start before walls were added
  double last_kick = 0.0;              ///< of the last step; 0: there is none
  RigidContact<Dim>* rigid = nullptr;  ///< of world.interactions, as the next
  Cavities<Dim>* cavities = nullptr;
  Gravity<Dim>* gravity = nullptr;

  Driver(std::vector<DeformableBody<Dim>> bodies, std::unique_ptr<Scheme<Dim>> given, const DynamicsOptions& options);

  void begin_ledger();          ///< entries that every run has
  void begin_watch();           ///< of the energy balance, from what it is next on
  double step(double at_most);  ///< as Dynamics::step
  void begin_supports();        ///< after velocities were prescribed
  void add_forces_of_walls();   ///< after such a start
  double choose_step(double at_most);
  void advance_nodes(double kick, double dt);  ///< nodes get their impulses, and move
  void add_external_forces();
  void break_points();
  void erode(const std::vector<Index>& broken);
  void inspect();  ///< how stiff points are, and whether the energy is what it should be
  EnergyBalance<Dim> balance() const;
  EnergyBalance<Dim> balance_with(const KineticEnergy& now) const;
  Ledger leapfrog_energies() const;  ///< of the balance that is checked: with KineticEnergy::resting
  void estimate_stable_step(Index most_products, bool is_due = true);
  void pack(Archive& archive);
  /// As Dynamics::begin_from.
  void begin_from(std::string_view state, bool velocities, const std::vector<std::string>& names);
  void set_stresses(const InitialStressField<Dim>& stress);  ///< as Dynamics::set_stresses
};

}  // namespace efree::internal
