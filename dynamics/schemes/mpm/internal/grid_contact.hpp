// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact between bodies at the nodes of the grid that they share (Bardenhagen, Brackbill & Sulsky 2000).
#pragma once

#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/schemes/mpm/internal/particles.hpp"

#include <memory>

namespace efree::internal {

/// Every body has a velocity of its own at a node. Those of two bodies must not approach each other by more than the
/// gap between their points around the node, along the normal from one to the other; friction by Coulomb's coefficient.
/// Impulses are equal and opposite at the same place: momenta are conserved. The grid must outlive the result.
template <int Dim> std::unique_ptr<Interaction<Dim>> grid_contact(const PointGrid<Dim>& grid, double friction);

}  // namespace efree::internal
