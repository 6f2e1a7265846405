// SPDX-License-Identifier: GPL-3.0-or-later
/// How long steps on the grid may be.
#pragma once

#include "efree/dynamics/schemes/mpm/internal/point_grid.hpp"

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

/// The highest frequency from step to step: estimated at intervals, between them a bound.
template <int Dim> class HighestFrequency {
 public:
  /// After points have moved, by Particles::strain.
  void add_strains(const PointGrid<Dim>& grid);
  /// After stresses and masses of the step are known, by Particles::fastest.
  void update(World<Dim>& world, PointGrid<Dim>& grid);
  double value() const { return value_; }  ///< angular [1/time]
  friend auto fields(HighestFrequency& of) {
    return std::tie(of.mode_, of.value_, of.wave_speed_, of.strain_, of.strain_since_estimate_);
  }

 private:
  FastestMode<Dim> mode_;
  double value_ = 0.0;
  double wave_speed_ = 0.0;                            ///< largest, of pressure waves
  double strain_ = 0.0, strain_since_estimate_ = 0.0;  ///< of a point, at most: in the last step, since then
};

}  // namespace efree::internal
