// SPDX-License-Identifier: GPL-3.0-or-later
/// Which particles are near each other.
#pragma once

#include "efree/core/types.hpp"
#include "efree/dynamics/schemes/sph/internal/wall_images.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace efree::internal {

/// A particle of a chunk, by its local number, and an image of one of the world, itself or another.
struct MirroredPair {
  std::uint32_t own, image;
  Index other;
};

/// Pairs of a particle are as many, or a multiple of it: the last may be with itself.
inline constexpr Index pairs_at_once = 4;

/// Pairs of a chunk of particles with each other, once each, and with those around the chunk.
struct ParticlePairs {
  std::vector<Index> particles;        ///< of the world by local number: those of the chunk, then those around it
  Index own = 0;                       ///< how many are of the chunk
  std::vector<Index> begin{0};         ///< by own particle: its first pair, and one past the last of all
  std::vector<std::uint16_t> other;    ///< by pair: local number, larger than that of the first, or the same
  std::vector<MirroredPair> mirrored;  ///< with images, ascending by `own`

  Index all() const { return static_cast<Index>(particles.size()); }
  Index count() const { return static_cast<Index>(other.size()); }
};

/// Pairs of all chunks that are closer than `reach` times the larger of their `size`. chunks: the particles of each.
/// Pairs with images likewise, once in each order. Throws NumericalError for a chunk with more than 65535 particles
/// around. Deterministic; linear in the number of particles.
template <int Dim> void find_pairs(const Points<Dim>& x, const Vector& size, double reach,
                                   const std::vector<std::span<const Index>>& chunks,
                                   const std::vector<WallImage<Dim>>& images, std::vector<ParticlePairs>& pairs);

/// How many particles are closer to another than `closer` times the mean of their `size`.
template <int Dim> std::int64_t count_close(const std::vector<ParticlePairs>& pairs, const Points<Dim>& x,
                                            const Vector& size, double closer);

}  // namespace efree::internal
