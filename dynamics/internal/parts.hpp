// SPDX-License-Identifier: GPL-3.0-or-later
/// What a run consists of.
#pragma once

#include "efree/dynamics/contact/internal/body_contact.hpp"
#include "efree/dynamics/contact/internal/rigid_contact.hpp"
#include "efree/dynamics/dynamics.hpp"
#include "efree/dynamics/fracture/internal/fracture.hpp"
#include "efree/dynamics/internal/loads.hpp"
#include "efree/dynamics/internal/stable_step.hpp"

namespace efree {
namespace internal {

/// The world at the start: nodes, and chunks of the points of all bodies without tables. Throws InputError for bodies
/// and options that make no sense.
template <int Dim>
void construct(World<Dim>& world, const std::vector<DeformableBody<Dim>>& bodies, const DynamicsOptions& options);
/// Moves the tables of all points to large pages, as every step goes through all of them.
template <int Dim> void use_large_pages(const World<Dim>& world);

}  // namespace internal

/// The state, the scheme and the interactions. The order of these is that in which they act.
template <int Dim> struct Dynamics<Dim>::Parts {
  World<Dim> world;
  std::unique_ptr<Scheme<Dim>> scheme;
  internal::StableStep<Dim> stable;
  internal::Fracture<Dim> fracture;
  EnergyWatch watch;
  internal::RigidContact<Dim>* rigid = nullptr;  ///< of world.interactions, as the next
  internal::Cavities<Dim>* cavities = nullptr;

  Parts(const std::vector<DeformableBody<Dim>>& bodies, std::unique_ptr<Scheme<Dim>> given,
        const DynamicsOptions& options);
  double step(double at_most);
  double choose_step(double at_most);
  void advance_nodes(double kick, double dt);
  void add_external_forces();
  void estimate_stable_step(Index most_products);
  void erode(const std::vector<Index>& broken);
  void break_points();
  void inspect();
  void begin_supports();
  EnergyBalance<Dim> balance() const;
  void pack(Archive& archive);
};

}  // namespace efree
