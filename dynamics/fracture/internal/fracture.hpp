// SPDX-License-Identifier: GPL-3.0-or-later
/// Material points that break: by eigenerosion, stretch, plastic strain or tension.
#pragma once

#include "efree/dynamics/scheme.hpp"

namespace efree::internal {

/// Damage of a chunk's points by the step that the material has just answered to. Those that are eroded bear no stress,
/// and keep their history.
template <int Dim> void update_damage(const World<Dim>& world, Chunk<Dim>& chunk, MaterialResponse& response);

/// C of energy release rates by the mean energy of a ball of radius r, G = C r mean(W). About a crack tip in plane
/// strain W is G (3 - 4 nu - c) (1 + c) / (8 pi (1 - nu) s) at the distance s, c the cosine to the crack's direction
/// (Sih 1974): (5/2 - 4 nu) on average, and the mean of 1 / s is 2 / r in a disk, 3 pi / (4 r) in a ball.
template <int Dim> double release_factor(double shear, double modulus);

/// The points bear no stress from now on: their energies are lost ("fracture"), and the scheme is told. Forces must be
/// assembled again.
template <int Dim> void erode_points(World<Dim>& world, Scheme<Dim>& scheme, const std::vector<Index>& broken);

/// Which points break.
template <int Dim> class Fracture {
 public:
  /// Points that break now, those that release most energy first.
  std::vector<Index> find_broken(const World<Dim>& world);
  /// M, energy release rates.
  Vector release_rates(const World<Dim>& world);

 private:
  void find_balls(const World<Dim>& world);
  double release_rate(const World<Dim>& world, Index point, const Vector& energies) const;
  Vector release_rates(const World<Dim>& world, const Vector& energies) const;

  // Points are numbered through all bodies.
  std::vector<Index> offsets_, balls_;  ///< by point: those that were near at the start, itself too
  Vector mass_;                         ///< of the ball
  Index point_changes_ = -1;            ///< of the world when these were found
};

}  // namespace efree::internal
