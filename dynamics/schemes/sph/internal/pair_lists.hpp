// SPDX-License-Identifier: GPL-3.0-or-later
/// Lists of pairs of particles that last for some steps (Verlet 1967).
#pragma once

#include "efree/dynamics/schemes/sph/internal/particle_pairs.hpp"
#include "efree/dynamics/state.hpp"

namespace efree::internal {

/// Pairs of particles, and of particles with images by walls, up to somewhat more than their support apart.
template <int Dim> class PairLists {
 public:
  /// Lists the pairs of particles at these positions. smoothing: their smoothing lengths. Throws NumericalError for
  /// positions that are not finite.
  void update(const World<Dim>& world, const Points<Dim>& x, const Vector& smoothing);
  /// Whether particles or images of them that are not listed may have come within the support of each other.
  bool is_due(const World<Dim>& world, const Vector& smoothing) const;

  const std::vector<ParticlePairs>& pairs() const { return pairs_; }  ///< by chunk
  const std::vector<WallImage<Dim>>& images() const { return images_; }
  const Points<Dim>& positions() const { return x_; }           ///< of the particles when pairs were listed
  double smallest_smoothing() const { return smallest_size_; }  ///< likewise
  /// The particles that have pairs with images, ascending.
  std::vector<Index> particles_at_walls() const;
  /// Call `update` with positions() after these were read.
  friend auto fields(PairLists& of) { return std::tie(of.x_); }

 private:
  std::vector<ParticlePairs> pairs_;
  std::vector<WallImage<Dim>> images_;
  std::size_t num_walls_ = 0;  ///< that these are of
  Points<Dim> x_;
  double smallest_size_ = 0.0;
};

}  // namespace efree::internal
