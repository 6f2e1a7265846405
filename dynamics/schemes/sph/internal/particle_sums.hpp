// SPDX-License-Identifier: GPL-3.0-or-later
/// Sums over the neighbours of particles: other particles, of all chunks, and images by walls.
#pragma once

#include "efree/core/aligned.hpp"
#include "efree/dynamics/schemes/sph/internal/mirrored_sums.hpp"
#include "efree/dynamics/schemes/sph/internal/pair_lists.hpp"
#include "efree/dynamics/schemes/sph/internal/splitting.hpp"

#include <type_traits>

namespace efree::internal {

/// What forces are summed of, by particle; tensors by their columns.
template <int Dim> struct ParticleStresses {
  Points<Dim * Dim> stress;       ///< over the square of the density
  Points<Dim * Dim> artificial;   ///< likewise; empty: none
  AlignedVector<double> density;  ///< two each: density and speed of pressure waves
};

/// The tensor of a particle among those of all.
template <class Tensors> auto of_particle(Tensors& tensors, Index particle) {
  constexpr int Dim = std::remove_cvref_t<Tensors>::RowsAtCompileTime == 4 ? 2 : 3;
  using Tensor = std::conditional_t<std::is_const_v<Tensors>, const Mat<Dim>, Mat<Dim>>;
  return Eigen::Map<Tensor>(tensors.col(particle).data());
}

/// Sums of a world by the pairs that are listed. It keeps references to all that it is made of.
template <int Dim> class ParticleSums {
 public:
  ParticleSums(const World<Dim>& world, const PairLists<Dim>& lists, const ParticleSizes& sizes, SmoothingKernel kernel)
      : world_(world), lists_(lists), sizes_(sizes), kernel_(kernel) {}

  /// As internal::sum_rates of a chunk, of these velocities where particles were that time ago by them: tensor_size
  /// numbers for each local particle. moments: false, the second result is null. Both are of this thread, until its
  /// next call.
  std::pair<const double*, const double*> rates(Index chunk, const Points<Dim>& v, double ago, bool moments) const;
  /// The moments where particles are now, which are the gradients of their positions. Likewise of this thread.
  const double* moments(Index chunk) const;
  /// Dim x N, forces of the stresses and of what `by` has besides; and the power lost to it, by chunk. by: stress and
  /// density do not matter, nor artificial, but null: none of it. wall_forces: of its nodes, by wall; null: not wanted.
  std::vector<LostPower> forces(const Points<Dim>& v, const ParticleStresses<Dim>& stresses, const PairForces& by,
                                Points<Dim>& forces, WallForces<Dim>* wall_forces) const;

 private:
  LocalParticles local_particles(const ParticlePairs& pairs, const Points<Dim>& v, double ago) const;
  MirroredParticles<Dim> mirrored(const Points<Dim>& v, double ago) const {
    const Nodes<Dim>& nodes = world_.nodes;
    return {lists_.images(), kernel_, nodes.x, v, ago, nodes.mass, sizes_.smoothing, sizes_.pressed};
  }

  const World<Dim>& world_;
  const PairLists<Dim>& lists_;
  const ParticleSizes& sizes_;
  SmoothingKernel kernel_;
};

}  // namespace efree::internal
