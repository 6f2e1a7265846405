// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/pair_kernels.hpp"

#include "efree/core/internal/vectors.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {
namespace {

/// Numbers by component, a lane for each of four pairs.
using Lanes = Four;
using FourIntegers = std::int64_t __attribute__((vector_size(32)));

EFREE_INLINE void transpose(Four& a, Four& b, Four& c, Four& d) {
  const Four even = __builtin_shufflevector(a, b, 0, 4, 2, 6), odd = __builtin_shufflevector(a, b, 1, 5, 3, 7),
             even_after = __builtin_shufflevector(c, d, 0, 4, 2, 6),
             odd_after = __builtin_shufflevector(c, d, 1, 5, 3, 7);
  a = __builtin_shufflevector(even, even_after, 0, 1, 4, 5);
  b = __builtin_shufflevector(odd, odd_after, 0, 1, 4, 5);
  c = __builtin_shufflevector(even, even_after, 2, 3, 6, 7);
  d = __builtin_shufflevector(odd, odd_after, 2, 3, 6, 7);
}
/// Four numbers of each of four particles, by component; `from` has so many of a particle.
EFREE_INLINE void gather(const double* from, int numbers, const std::uint16_t* particles, Lanes* components) {
  Four a, b, c, d;  // no array: its memory would be written and read by parts
  load(a, from + numbers * particles[0]);
  load(b, from + numbers * particles[1]);
  load(c, from + numbers * particles[2]);
  load(d, from + numbers * particles[3]);
  transpose(a, b, c, d);
  components[0] = a;
  components[1] = b;
  components[2] = c;
  components[3] = d;
}
EFREE_INLINE void subtract(double* from, const Four& what) {
  Four value;
  load(value, from);
  value -= what;
  store(from, value);
}
/// Subtracts components from four numbers of each of four particles.
EFREE_INLINE void subtract(double* from, int numbers, const std::uint16_t* particles, const Lanes* components) {
  Four a = components[0], b = components[1], c = components[2], d = components[3];
  transpose(a, b, c, d);
  subtract(from + numbers * particles[0], a);
  subtract(from + numbers * particles[1], b);
  subtract(from + numbers * particles[2], c);
  subtract(from + numbers * particles[3], d);
}
EFREE_INLINE double sum(const Lanes& v) {
  return (v[0] + v[2]) + (v[1] + v[3]);
}

/// 1 / sqrt(x), large where x is zero: half of the bits, nearly, and Newton's method, two digits more for each one.
EFREE_INLINE void find_inverse_root(const Lanes& x, Lanes& result) {
  const FourIntegers bits = 0x5fe6eb50c7b537a9 - (__builtin_bit_cast(FourIntegers, x) >> 1);
  result = __builtin_bit_cast(Lanes, bits);
  for (int k = 0; k < 4; ++k) result *= 1.5 - 0.5 * x * result * result;
}
/// w'(q) / q, as kernel_slope. inverse: 1 / q.
EFREE_INLINE void find_slope(SmoothingKernel kernel, const Lanes& q, const Lanes& inverse, Lanes& slope) {
  const Lanes none = {};
  if (kernel == SmoothingKernel::cubic_spline) {
    const Lanes inner = -3.0 + 2.25 * q, left = 2.0 - q, outer = -0.75 * left * left * inverse;
    slope = q < 1.0 ? inner : outer;
  } else {
    const Lanes s = 1.0 - 0.5 * q;
    slope = -5.0 * s * s * s;
  }
  slope = q < 2.0 ? slope : none;
}
/// Times over_h^(Dim + 2).
template <int Dim, class Number> EFREE_INLINE void multiply_by_power(const Number& over_h, Lanes& slope) {
  Number power = over_h * over_h;
  power *= power;
  if constexpr (Dim == 3) power *= over_h;
  slope *= power;
}

/// A particle with four others.
template <int Dim> struct FourPairs {
  Lanes d[Dim], dv[Dim];  ///< position and velocity less those of the others
  Lanes over_h, mass;     ///< of the others
  Lanes squared = {};     ///< distance
  Lanes slope;            ///< W'(r) / r, with unequal smoothing lengths the mean of both

  EFREE_INLINE FourPairs(const LocalParticles& of, Index i, const std::uint16_t* others) {
    const double *x = of.x + 4 * i, *v = of.v + 4 * i;
    Lanes xj[4], vj[4], inverse;
    gather(of.x, 4, others, xj);
    gather(of.v, 4, others, vj);
    for (int c = 0; c < Dim; ++c) {
      d[c] = x[c] - xj[c];
      dv[c] = v[c] - vj[c];
      squared += d[c] * d[c];
    }
    over_h = xj[3];
    mass = vj[3];
    find_inverse_root(squared, inverse);
    const Lanes r = squared * inverse;
    find_slope(of.kernel, x[3] * r, inverse / x[3], slope);
    multiply_by_power<Dim>(x[3], slope);
    if (!of.one_size) {
      Lanes theirs;
      find_slope(of.kernel, over_h * r, inverse / over_h, theirs);
      multiply_by_power<Dim>(over_h, theirs);
      slope = 0.5 * (slope + theirs);
    }
    slope *= kernel_norm(of.kernel, Dim);
  }
};

/// Adds a vector (x) d for pairs of a particle: to its own sums what the others' masses make of it, and to those of the
/// others what its mass does.
template <int Dim> EFREE_INLINE void add_outer(const FourPairs<Dim>& pairs, const Lanes* vector, double mass,
                                               const std::uint16_t* others, Lanes* own, double* rates) {
  constexpr int size = tensor_size(Dim);
  Lanes product[size] = {};
  for (int j = 0; j < Dim; ++j) {
    const Lanes weighted = pairs.slope * pairs.d[j];
    for (int i = 0; i < Dim; ++i) {
      const int k = tensor_index(Dim, i, j);
      product[k] = weighted * vector[i];
      own[k] += pairs.mass * product[k];
      product[k] *= mass;
    }
  }
  for (int k = 0; k < size; k += 4) subtract(rates + k, size, others, product + k);
}

template <int Dim, bool has_moments>
EFREE_INLINE void sum_rates_of(const ParticlePairs& pairs, const LocalParticles& of, double* rates, double* moments) {
  constexpr int size = tensor_size(Dim);
  for (Index k = 0; k < size * pairs.all(); ++k) rates[k] = 0.0;
  for (Index k = 0; has_moments && k < size * pairs.all(); ++k) moments[k] = 0.0;
  for (Index i = 0; i < pairs.own; ++i) {
    const double mass = of.v[4 * i + 3];
    Lanes rate[size] = {}, moment[size] = {};
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; k += pairs_at_once) {
      const std::uint16_t* others = pairs.other.data() + k;
      const FourPairs<Dim> four(of, i, others);
      add_outer(four, four.dv, mass, others, rate, rates);
      if constexpr (has_moments) add_outer(four, four.d, mass, others, moment, moments);
    }
    for (int k = 0; k < size; ++k) {
      rates[size * i + k] -= sum(rate[k]);
      if constexpr (has_moments) moments[size * i + k] -= sum(moment[k]);
    }
  }
}

/// Adds the sum of the tensors of a particle and of four others, times their distance vectors.
template <int Dim> EFREE_INLINE void add_products(const double* tensors, Index i, const std::uint16_t* others,
                                                  const Lanes* d, Lanes* result) {
  constexpr int size = tensor_size(Dim), columns = size / 4, in_a_column = Dim == 2 ? 2 : 4;
  for (int c = 0; c < columns; ++c) {
    Lanes tensor[4];
    gather(tensors + 4 * c, size, others, tensor);
    for (int k = 0; k < 4; ++k) {
      const int row = k % in_a_column, column = Dim == 2 ? k / in_a_column : c;
      if (row < Dim) result[row] += (tensors[size * i + 4 * c + k] + tensor[k]) * d[column];
    }
  }
}

/// LostPower by lanes, the last against its sign. Summed up beyond the kernel: GCC 12 takes lanes from wide registers
/// after it has cleared them for the caller, which is then slow.
struct LostLanes {
  double viscous[4], artificial[4], least[4];
};

/// factors: of the artificial stress, by pair.
template <int Dim> EFREE_INLINE void sum_forces_of(const ParticlePairs& pairs, const LocalParticles& of,
                                                   const PairForces& by, const double* factors, double* forces,
                                                   LostLanes& lost) {
  for (Index k = 0; k < 4 * pairs.all(); ++k) forces[k] = 0.0;
  const bool has_viscosity = by.linear > 0.0 || by.quadratic > 0.0;
  Lanes viscous = {}, artificial = {}, least = {};
  for (Index i = 0; i < pairs.own; ++i) {
    const double *x = of.x + 4 * i, *v = of.v + 4 * i, *density = by.density + 2 * i;
    Lanes total[Dim] = {};
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; k += pairs_at_once) {
      const std::uint16_t* others = pairs.other.data() + k;
      const FourPairs<Dim> four(of, i, others);
      const Lanes weight = v[3] * four.mass * four.slope;
      Lanes share, force[4] = {};
      for (int l = 0; l < 4; ++l) share[l] = others[l] < pairs.own ? 1.0 : 0.5;
      share *= weight;
      add_products<Dim>(by.stress, i, others, four.d, force);
      if (has_viscosity) {
        Lanes rho, sound, along = {};
        for (int l = 0; l < 4; ++l) {
          rho[l] = by.density[2 * others[l]];
          sound[l] = by.density[2 * others[l] + 1];
        }
        for (int c = 0; c < Dim; ++c) along += four.d[c] * four.dv[c];
        const Lanes none = {}, h = 2.0 / (x[3] + four.over_h), approach = along < 0.0 ? along : none;
        const Lanes q = h * approach / (four.squared + 0.01 * h * h);
        const Lanes pi = q * (by.quadratic * q - 0.5 * by.linear * (density[1] + sound)) / (0.5 * (density[0] + rho));
        least = q < least ? q : least;
        viscous += share * pi * along;
        for (int c = 0; c < Dim; ++c) force[c] -= pi * four.d[c];
      }
      if (by.artificial) {
        Lanes more[4] = {}, factor;
        load(factor, factors + k);
        add_products<Dim>(by.artificial, i, others, four.d, more);
        for (int c = 0; c < Dim; ++c) {
          more[c] *= factor;
          artificial -= share * more[c] * four.dv[c];
          force[c] += more[c];
        }
      }
      for (int c = 0; c < Dim; ++c) {
        force[c] *= weight;
        total[c] += force[c];
      }
      subtract(forces, 4, others, force);
    }
    for (int c = 0; c < Dim; ++c) forces[4 * i + c] += sum(total[c]);
  }
  store(lost.viscous, viscous);
  store(lost.artificial, artificial);
  store(lost.least, least);
}

EFREE_FOR_EACH_MACHINE void rates_kernel(const ParticlePairs& pairs, const LocalParticles& of, double* rates,
                                         double* moments) {
  if (of.dim == 2)
    moments ? sum_rates_of<2, true>(pairs, of, rates, moments) : sum_rates_of<2, false>(pairs, of, rates, moments);
  else
    moments ? sum_rates_of<3, true>(pairs, of, rates, moments) : sum_rates_of<3, false>(pairs, of, rates, moments);
}
EFREE_FOR_EACH_MACHINE void forces_kernel(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by,
                                          const double* factors, double* forces, LostLanes& lost) {
  of.dim == 2 ? sum_forces_of<2>(pairs, of, by, factors, forces, lost)
              : sum_forces_of<3>(pairs, of, by, factors, forces, lost);
}

/// (W(r) / W(reference))^exponent of all pairs, with the mean of their smoothing lengths.
void find_artificial(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by,
                     std::vector<double>& factors) {
  const double reference = kernel_shape(of.kernel, by.reference);
  factors.resize(pairs.other.size());
  for (Index i = 0; i < pairs.own; ++i)
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; ++k) {
      const Index j = pairs.other[k];
      double sum = 0.0;
      for (int d = 0; d < of.dim; ++d) {
        const double difference = of.x[4 * i + d] - of.x[4 * j + d];
        sum += difference * difference;
      }
      const double over_h = 0.5 * (of.x[4 * i + 3] + of.x[4 * j + 3]);
      factors[k] = std::pow(kernel_shape(of.kernel, over_h * std::sqrt(sum)) / reference, by.exponent);
    }
}

}  // namespace

void sum_rates(const ParticlePairs& pairs, const LocalParticles& of, double* rates, double* moments) {
  rates_kernel(pairs, of, rates, moments);
}

LostPower sum_forces(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by, double* forces) {
  thread_local std::vector<double> factors;
  if (by.artificial) find_artificial(pairs, of, by, factors);
  LostLanes lanes;
  forces_kernel(pairs, of, by, factors.data(), forces, lanes);
  LostPower lost;
  for (int l = 0; l < 4; ++l) {
    lost.viscous += lanes.viscous[l];
    lost.artificial += lanes.artificial[l];
    lost.approach = std::max(lost.approach, -lanes.least[l]);
  }
  return lost;
}

}  // namespace efree::internal
