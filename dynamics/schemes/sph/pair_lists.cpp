// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/pair_lists.hpp"

#include "efree/core/error.hpp"
#include "efree/dynamics/schemes/sph/smoothing_kernel.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// How much further than the support, over the smoothing length, pairs are listed.
constexpr double list_skin = 0.25;

}  // namespace

template <int Dim> void PairLists<Dim>::update(const World<Dim>& world, const Points<Dim>& x, const Vector& smoothing) {
  if (!x.allFinite()) throw NumericalError(fmt::format("at time {:.6g} particles are nowhere", world.time));
  std::vector<std::vector<Index>> particles(world.chunks.size());
  std::vector<std::span<const Index>> chunks;
  for (std::size_t c = 0; c < world.chunks.size(); ++c) {
    const Chunk<Dim>& chunk = world.chunks[c];
    for (Index p = 0; p < chunk.size(); ++p) particles[c].push_back(world.point_number(chunk, p));
    chunks.emplace_back(particles[c]);
  }
  images_ = images_by(world.walls);
  num_walls_ = world.walls.size();
  find_pairs<Dim>(x, smoothing, kernel_support + list_skin, chunks, images_, pairs_);
  if (&x != &x_) x_ = x;
  smallest_size_ = smoothing.minCoeff();
}

template <int Dim> bool PairLists<Dim>::is_due(const World<Dim>& world, const Vector& smoothing) const {
  if (num_walls_ != world.walls.size()) return true;
  const Points<Dim> moved = world.nodes.x - x_;
  // What all have moved together brings no particles closer to each other, but images of them.
  double furthest = (moved.colwise() - Vec<Dim>(moved.rowwise().mean())).colwise().squaredNorm().maxCoeff();
  for (const Wall<Dim>& wall : world.walls) {
    const double nearest = (wall.normal.transpose() * world.nodes.x).minCoeff() - wall.level;
    if (nearest > kernel_support * smoothing.maxCoeff()) continue;
    const double approach = std::max(0.0, -(wall.normal.transpose() * moved).minCoeff());
    furthest += approach * approach;
  }
  const double most = 0.5 * list_skin * smallest_size_;
  return !(furthest < most * most);
}

template <int Dim> std::vector<Index> PairLists<Dim>::particles_at_walls() const {
  std::vector<Index> result;
  for (const ParticlePairs& pairs : pairs_)
    for (Index last = -1; const MirroredPair& pair : pairs.mirrored)
      if (const Index own = static_cast<Index>(pair.own); std::exchange(last, own) != own)
        result.push_back(pairs.particles[own]);
  std::ranges::sort(result);
  return result;
}

template class PairLists<2>;
template class PairLists<3>;

}  // namespace efree::internal
