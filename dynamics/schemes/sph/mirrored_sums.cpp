// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/mirrored_sums.hpp"

#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

/// Calls visit(own, other, image, e, slope) for the pairs that are pressed on the walls of their image: local number of
/// the first, number in the world of the one that is mirrored; vector from its image to the first, W'(r) / r of it.
template <int Dim, class Visit>
void for_each_pressed(const ParticlePairs& pairs, const MirroredParticles<Dim>& of, const Visit& visit) {
  const auto at = [&](Index a) { return Vec<Dim>(of.x.col(a) - of.ago * of.v.col(a)); };
  const auto slope = [&](double r, Index a) { return kernel_slope_over_distance(of.kernel, Dim, r, of.smoothing[a]); };
  for (const MirroredPair& pair : pairs.mirrored) {
    const WallImage<Dim>& image = of.images[pair.image];
    const Index first = pairs.particles[pair.own];
    if ((of.pressed[first] & of.pressed[pair.other] & image.walls) != image.walls) continue;
    const Vec<Dim> e = at(first) - image.of(at(pair.other));
    const double r = e.norm();
    visit(pair.own, pair.other, image, e, 0.5 * (slope(r, first) + slope(r, pair.other)));
  }
}

}  // namespace

template <int Dim>
void add_mirrored_rates(const ParticlePairs& pairs, const MirroredParticles<Dim>& of, double* rates, double* moments) {
  constexpr int size = tensor_size(Dim);
  for_each_pressed(pairs, of, [&](Index i, Index j, const WallImage<Dim>& image, const Vec<Dim>& e, double slope) {
    const Vec<Dim> change = of.mass[j] * slope * (image.A * of.v.col(j) - of.v.col(pairs.particles[i]));
    if (rates) add_tensor<Dim>(change * e.transpose(), rates + size * i);
    if (moments) add_tensor<Dim>(-of.mass[j] * slope * e * e.transpose(), moments + size * i);
  });
}

template <int Dim> LostPower add_mirrored_forces(const ParticlePairs& pairs, const MirroredParticles<Dim>& of,
                                                 const PairForces& by, const std::vector<Wall<Dim>>& walls,
                                                 double* forces, WallForces<Dim>* wall_forces) {
  LostPower lost;
  Index last = -1, row = -1;  // of a particle in the wall forces
  for_each_pressed(pairs, of, [&](Index i, Index j, const WallImage<Dim>& image, const Vec<Dim>& e, double slope) {
    const Index a = pairs.particles[i];
    using Tensor = Eigen::Map<const Mat<Dim>>;
    const Mat<Dim> stress = Tensor(by.stress + Dim * Dim * a) + image.A * Tensor(by.stress + Dim * Dim * j) * image.Q;
    const double weight = of.mass[a] * of.mass[j] * slope;
    Vec<Dim> force = weight * stress * e;
    const Vec<Dim> relative = of.v.col(a) - image.A * of.v.col(j);
    if (const double approach = relative.dot(e); approach < 0.0 && (by.linear > 0.0 || by.quadratic > 0.0)) {
      const double h = 0.5 * (of.smoothing[a] + of.smoothing[j]);
      const double q = h * approach / (e.squaredNorm() + 0.01 * h * h);
      const double density = 0.5 * (by.density[2 * a] + by.density[2 * j]),
                   sound = 0.5 * (by.density[2 * a + 1] + by.density[2 * j + 1]);
      const double pi = q * (by.quadratic * q - by.linear * sound) / density;
      force -= weight * pi * e;
      lost.viscous += weight * pi * e.dot(of.v.col(a));
      lost.approach = std::max(lost.approach, -q);
    }
    for (int d = 0; d < Dim; ++d) forces[4 * i + d] += force[d];
    if (!wall_forces) return;
    if (std::exchange(last, a) != a)
      row = static_cast<Index>(std::ranges::lower_bound(wall_forces->nodes, a) - wall_forces->nodes.begin());
    Vec<Dim> rest = force;
    Index first = -1;
    for (std::size_t w = 0; w < walls.size(); ++w) {
      if ((image.walls >> w & 1) == 0) continue;
      const Vec<Dim>& n = walls[w].normal;
      const Vec<Dim> normal = n.dot(force) * n;
      wall_forces->forces[w].col(row) += normal;
      rest -= normal;
      if (first < 0) first = static_cast<Index>(w);
    }
    wall_forces->forces[first].col(row) += rest;
  });
  return lost;
}

#define EFREE_INSTANTIATE(Dim)                                                                                   \
  template void add_mirrored_rates(const ParticlePairs&, const MirroredParticles<Dim>&, double*, double*);       \
  template LostPower add_mirrored_forces(const ParticlePairs&, const MirroredParticles<Dim>&, const PairForces&, \
                                         const std::vector<Wall<Dim>>&, double*, WallForces<Dim>*);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
