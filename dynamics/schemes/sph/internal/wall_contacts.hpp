// SPDX-License-Identifier: GPL-3.0-or-later
/// Which particles are pressed on walls: these push, and hold nothing.
#pragma once

#include "efree/dynamics/schemes/sph/internal/particle_pairs.hpp"
#include "efree/dynamics/state.hpp"

namespace efree::internal {

template <int Dim> class WallContacts {
 public:
  void resize(std::size_t particles);
  /// Particles of a chunk, by their stresses in Chunk::columns: in contact with a wall where these are a pressure on
  /// it, or zero and they are nearer than their radius; detached from it where they pull.
  void find(const World<Dim>& world, const Chunk<Dim>& chunk);
  /// By particle the walls that it is pressed on. Images act on particles in contact and on those in reach of these
  /// particles' images, unless they are detached: all of them begin at once, without stress yet, not one after the
  /// other as a wave passes and forces jump.
  void find_pressed(const std::vector<ParticlePairs>& pairs, const std::vector<WallImage<Dim>>& images,
                    std::vector<WallBits>& pressed) const;
  /// Walls do not pull particles that the stresses of this step detach.
  void detach(std::vector<WallBits>& pressed) const;
  friend auto fields(WallContacts& of) { return std::tie(of.in_contact_, of.detached_); }

 private:
  std::vector<WallBits> in_contact_, detached_;  ///< by particle
};

}  // namespace efree::internal
