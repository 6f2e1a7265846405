// SPDX-License-Identifier: GPL-3.0-or-later
/// Sums over pairs of particles.
#pragma once

#include "efree/dynamics/schemes/sph/internal/particle_pairs.hpp"
#include "efree/dynamics/schemes/sph/smoothing_kernel.hpp"

namespace efree::internal {

/// Numbers of a second-order tensor in these arrays: its columns, in space padded to four.
constexpr int tensor_size(int dim) {
  return dim == 2 ? 4 : 12;
}
constexpr int tensor_index(int dim, int i, int j) {
  return (dim == 2 ? 2 : 4) * j + i;
}

/// A tensor in these arrays.
template <int Dim> Mat<Dim> tensor_at(const double* from) {
  Mat<Dim> result;
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) result(i, j) = from[tensor_index(Dim, i, j)];
  return result;
}
template <int Dim> void put_tensor(const Mat<Dim>& tensor, double* to) {
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) to[tensor_index(Dim, i, j)] = tensor(i, j);
}
template <int Dim> void add_tensor(const Mat<Dim>& more, double* to) {
  for (int j = 0; j < Dim; ++j)
    for (int i = 0; i < Dim; ++i) to[tensor_index(Dim, i, j)] += more(i, j);
}

/// Particles by local number of ParticlePairs.
struct LocalParticles {
  int dim;
  SmoothingKernel kernel;
  bool one_size;    ///< whether all have the same smoothing length
  const double* x;  ///< four each: position, in the plane a zero, and 1 over the smoothing length
  const double* v;  ///< four each: velocity, in the plane a zero, and mass
};

/// sum m_j (v_j - v_i) (x) grad W_ij, tensor_size numbers for every local particle; those of the chunk are complete.
/// moments: likewise sum m_j (x_j - x_i) (x) grad W_ij; none: they are not wanted.
void sum_rates(const ParticlePairs& pairs, const LocalParticles& of, double* rates, double* moments = nullptr);

/// What forces take besides.
struct PairForces {
  const double* stress = nullptr;        ///< sigma / rho^2, tensor_size numbers each
  const double* density = nullptr;       ///< two each: density and speed of pressure waves
  double linear = 0.0, quadratic = 0.0;  ///< of the artificial viscosity
  const double* artificial = nullptr;    ///< as `stress`: times (W(r) / W(reference))^exponent
  double reference = 1.0;                ///< over the smoothing length
  double exponent = 1.0;
};
/// Power that pairs lose to the artificial parts, those of two chunks half in each; and the largest q of their
/// viscosity [length/time].
struct LostPower {
  double viscous = 0.0, artificial = 0.0, approach = 0.0;
};
/// Forces, four numbers for every local particle; those of the chunk are complete. Every pair has opposite ones, along
/// with those that another chunk finds for it.
LostPower sum_forces(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by, double* forces);

}  // namespace efree::internal
