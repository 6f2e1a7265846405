// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/particle_sums.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

/// Arrays by local number, of this thread.
struct LocalArrays {
  AlignedVector<double> x, v, stress, artificial, density, sums, moments;
};
LocalArrays& local_arrays() {
  thread_local LocalArrays arrays;
  return arrays;
}

double* grown(AlignedVector<double>& array, std::size_t size) {
  if (array.size() < size) array.resize(size);
  return array.data();
}

template <int Dim>
const double* gather_tensors(const Points<Dim * Dim>& of, const ParticlePairs& pairs, AlignedVector<double>& to) {
  constexpr int size = tensor_size(Dim);
  double* result = grown(to, size * pairs.particles.size());
  for (std::size_t l = 0; l < pairs.particles.size(); ++l)
    put_tensor<Dim>(of_particle(of, pairs.particles[l]), result + size * l);
  return result;
}

}  // namespace

/// Particles with these velocities, where they were that time ago by them.
template <int Dim> LocalParticles ParticleSums<Dim>::local_particles(const ParticlePairs& pairs,
                                                                     const Points<Dim>& velocities, double ago) const {
  const std::size_t n = pairs.particles.size();
  double* const all_x = grown(local_arrays().x, 4 * n);
  double* const all_v = grown(local_arrays().v, 4 * n);
  const Nodes<Dim>& nodes = world_.nodes;
  bool one_size = true;
  for (std::size_t l = 0; l < n; ++l) {
    const Index a = pairs.particles[l];
    double *x = all_x + 4 * l, *v = all_v + 4 * l;
    x[2] = v[2] = 0.0;
    for (int i = 0; i < Dim; ++i) {
      v[i] = velocities(i, a);
      x[i] = nodes.x(i, a) - ago * v[i];
    }
    x[3] = 1.0 / sizes_.smoothing[a];
    v[3] = nodes.mass[a];
    one_size = one_size && x[3] == all_x[3];
  }
  return {.dim = Dim, .kernel = kernel_, .one_size = one_size, .x = all_x, .v = all_v};
}

template <int Dim> std::pair<const double*, const double*> ParticleSums<Dim>::rates(Index chunk, const Points<Dim>& v,
                                                                                    double ago, bool moments) const {
  const ParticlePairs& pairs = lists_.pairs()[chunk];
  const std::size_t size = tensor_size(Dim) * pairs.particles.size();
  double* const rates = grown(local_arrays().sums, size);
  double* const second = moments ? grown(local_arrays().moments, size) : nullptr;
  sum_rates(pairs, local_particles(pairs, v, ago), rates, second);
  add_mirrored_rates(pairs, mirrored(v, ago), rates, second);
  return {rates, second};
}

template <int Dim> const double* ParticleSums<Dim>::moments(Index chunk) const {
  const ParticlePairs& pairs = lists_.pairs()[chunk];
  double* const result = grown(local_arrays().moments, tensor_size(Dim) * pairs.particles.size());
  sum_rates(pairs, local_particles(pairs, world_.nodes.x, 0.0), result);
  add_mirrored_rates(pairs, mirrored(world_.nodes.v, 0.0), nullptr, result);
  return result;
}

template <int Dim> std::vector<LostPower> ParticleSums<Dim>::forces(const Points<Dim>& v,
                                                                    const ParticleStresses<Dim>& stresses,
                                                                    const PairForces& by, Points<Dim>& forces,
                                                                    WallForces<Dim>* wall_forces) const {
  if (wall_forces) {
    wall_forces->forces.resize(world_.walls.size());
    for (auto& of : wall_forces->forces) of.setZero(Dim, std::ssize(wall_forces->nodes));
  }
  std::vector<LostPower> lost(lists_.pairs().size());
  parallel_chunks(static_cast<Index>(lost.size()), 1, [&](Index c, Index) {
    const ParticlePairs& pairs = lists_.pairs()[c];
    LocalArrays& arrays = local_arrays();
    const std::size_t n = pairs.particles.size();
    PairForces local = by;
    local.stress = gather_tensors<Dim>(stresses.stress, pairs, arrays.stress);
    double* const density = grown(arrays.density, 2 * n);
    for (std::size_t l = 0; l < n; ++l)
      std::copy_n(stresses.density.data() + 2 * pairs.particles[l], 2, density + 2 * l);
    local.density = density;
    if (by.artificial) local.artificial = gather_tensors<Dim>(stresses.artificial, pairs, arrays.artificial);
    double* const sums = grown(arrays.sums, 4 * n);
    lost[c] = sum_forces(pairs, local_particles(pairs, v, 0.0), local, sums);
    local.stress = stresses.stress.data();
    local.density = stresses.density.data();
    const LostPower by_walls = add_mirrored_forces(pairs, mirrored(v, 0.0), local, world_.walls, sums, wall_forces);
    lost[c].viscous += by_walls.viscous;
    lost[c].approach = std::max(lost[c].approach, by_walls.approach);
    for (Index l = 0; l < pairs.own; ++l) forces.col(pairs.particles[l]) = Eigen::Map<const Vec<Dim>>(sums + 4 * l);
  });
  return lost;
}

template class ParticleSums<2>;
template class ParticleSums<3>;

}  // namespace efree::internal
