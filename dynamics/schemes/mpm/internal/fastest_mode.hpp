// SPDX-License-Identifier: GPL-3.0-or-later
/// How long steps on the grid may be.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/particles.hpp"

namespace efree::internal {

/// The highest frequency of the points on the grid, estimated from below by power iteration, which begins with the
/// fastest mode of an earlier grid. Every strain counts as stiff as that of a pressure wave, so no material has more.
template <int Dim> class FastestMode {
 public:
  /// The square of the angular frequency [1/time^2], by so many products with the stiffness; 0 where nothing is stiff.
  double estimate(World<Dim>& world, PointGrid<Dim>& grid, int products);

  friend auto fields(FastestMode& of) { return std::tie(of.grids_, of.mode_, of.estimates_); }

 private:
  void move_to_grid(const World<Dim>& world, const PointGrid<Dim>& grid);

  std::vector<SparseGrid<Dim>> grids_;  ///< of the mode, by body
  Points<Dim> mode_;                    ///< Dim x N
  std::int64_t estimates_ = 0;          ///< so far
};

}  // namespace efree::internal
