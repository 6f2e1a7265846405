// SPDX-License-Identifier: GPL-3.0-or-later
/// Contact between bodies at the nodes of the grid that they share (Bardenhagen, Brackbill & Sulsky 2000), and of
/// particles with rigid bodies.
#pragma once

#include "efree/dynamics/contact/contact_points.hpp"
#include "efree/dynamics/interaction.hpp"
#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"

#include <memory>

namespace efree::internal {

/// Every body has a velocity of its own at a node. Those of two bodies must not approach each other by more than the
/// gap between their points around the node, along the normal from one to the other; friction by Coulomb's coefficient.
/// Impulses are equal and opposite at the same place: momenta are conserved. The grid must outlive the result.
template <int Dim> std::unique_ptr<Interaction<Dim>> grid_contact(const PointGrid<Dim>& grid, double friction);

/// Particles whose surface (Particles::reach) is nearer to the rigid body than that: bodies end where their particles
/// do, not at the last node.
template <int Dim> ContactPoints<Dim> find_contact_points(const World<Dim>& world, const PointGrid<Dim>& grid,
                                                          const RigidShape<Dim>& gap_at, double reach);

}  // namespace efree::internal
