// SPDX-License-Identifier: GPL-3.0-or-later
/// Momentum and energy of the nodes from the grid of one step to that of the next.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"

#include <array>
#include <optional>

namespace efree::internal {

/// Momenta of bodies before and after velocities went to the points and to a new grid, and the kinetic energy that this
/// takes. Rounding is much the same in every step and would be drift: what it takes from a momentum is added up, and
/// goes back to the nodes when their velocities can hold it.
template <int Dim> class TransferBalance {
 public:
  void begin(Index num_bodies);
  /// Before the world gets other nodes.
  void leave_grid(const World<Dim>& world);
  /// When the new nodes have velocities and forces: corrects the momenta, and adds the energy to the ledger. Nothing
  /// without leave_grid before it.
  void take_grid(World<Dim>& world, const PointGrid<Dim>& grid);
  friend auto fields(TransferBalance& of) { return std::tie(of.owed_); }

 private:
  void return_momentum(World<Dim>& world);

  // Of the grid that is left: its kinetic energy, and by body its momentum.
  std::optional<double> energy_before_;
  std::vector<std::array<long double, Dim>> momentum_before_;
  Points<Dim> owed_;  ///< Dim x bodies, momentum that rounding has kept in transfers so far
};

}  // namespace efree::internal
