// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/wall_contacts.hpp"

#include "efree/core/parallel.hpp"

namespace efree::internal {
namespace {

/// Distance from a wall, over the radius, up to which particles may be in contact with it.
constexpr double contact_reach = 1.25;

}  // namespace

template <int Dim> void WallContacts<Dim>::resize(std::size_t particles) {
  in_contact_.resize(particles, 0);
  detached_.resize(particles, 0);
}

template <int Dim> void WallContacts<Dim>::find(const World<Dim>& world, const Chunk<Dim>& chunk) {
  const double* columns = chunk.columns();
  for (Index p = 0; p < chunk.size(); ++p) {
    const Index a = world.point_number(chunk, p);
    in_contact_[a] = detached_[a] = 0;
    for (std::size_t w = 0; w < world.walls.size(); ++w) {
      const WallBits bit = WallBits{1} << w;
      const Vec<Dim>& n = world.walls[w].normal;
      double pull = 0.0;
      for (int j = 0; j < Dim; ++j)
        for (int i = 0; i < Dim; ++i) pull += n[i] * columns[16 * p + 4 * j + i] * n[j];
      if (pull > 0.0 || chunk.is_eroded(p)) {
        detached_[a] |= bit;
        continue;
      }
      const double gap = n.dot(world.nodes.x.col(a)) - world.walls[w].level;
      if (gap < (pull < 0.0 ? contact_reach : 1.0) * world.nodes.radius[a]) in_contact_[a] |= bit;
    }
  }
}

template <int Dim> void WallContacts<Dim>::find_pressed(const std::vector<ParticlePairs>& pairs,
                                                        const std::vector<WallImage<Dim>>& images,
                                                        std::vector<WallBits>& pressed) const {
  pressed.resize(in_contact_.size());
  parallel_chunks(static_cast<Index>(pairs.size()), 1, [&](Index c, Index) {
    const ParticlePairs& of = pairs[c];
    for (Index i = 0; i < of.own; ++i) pressed[of.particles[i]] = in_contact_[of.particles[i]];
    for (const MirroredPair& pair : of.mirrored) {
      const Index a = of.particles[pair.own];
      pressed[a] |= in_contact_[pair.other] & images[pair.image].walls & ~detached_[a];
    }
  });
}

template <int Dim> void WallContacts<Dim>::detach(std::vector<WallBits>& pressed) const {
  for (std::size_t a = 0; a < detached_.size(); ++a) pressed[a] &= ~detached_[a];
}

template class WallContacts<2>;
template class WallContacts<3>;

}  // namespace efree::internal
