// SPDX-License-Identifier: GPL-3.0-or-later
/// How bodies come to rest.
#pragma once

#include "efree/dynamics/interaction.hpp"

namespace efree::internal {

/// DynamicsOptions::damping and rest_from. What they take is "damping" in the ledger.
template <int Dim> std::unique_ptr<Interaction<Dim>> damping();

/// Dynamics::residual; kick: how long the forces of the last step acted on velocities.
template <int Dim> double residual(const World<Dim>& world, double kick);
/// Dynamics::imbalance.
template <int Dim> double imbalance(const World<Dim>& world, const std::vector<Index>& in_contact);

}  // namespace efree::internal
