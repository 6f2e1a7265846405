// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/pair_kernels.hpp"

#include "efree/core/aligned.hpp"
#include "efree/core/internal/vectors.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

/// A number for every pair.
enum Column { slope, approach, density, sound, along, artificial, num_columns };
struct PairColumns {
  AlignedVector<double> room;
  std::size_t size;
  double* operator[](Column column) { return room.data() + column * size; }
};
PairColumns& columns_for(const ParticlePairs& pairs) {
  thread_local PairColumns columns;
  columns.size = static_cast<std::size_t>(pairs.count() + 7) / 8 * 8;
  columns.room.resize(std::max(columns.room.size(), num_columns * columns.size));
  return columns;
}

/// Calls visit(i, j, pair) for all pairs.
template <class Visit> EFREE_INLINE void for_each_pair(const ParticlePairs& pairs, const Visit& visit) {
  const Index* begin = pairs.begin.data();
  const std::uint16_t* other = pairs.other.data();
  for (Index i = 0; i < pairs.own; ++i)
    for (Index k = begin[i]; k < begin[i + 1]; ++k) visit(i, static_cast<Index>(other[k]), k);
}

template <SmoothingKernel kernel> EFREE_INLINE double kernel_slope_by(double q) {
  if constexpr (kernel == SmoothingKernel::cubic_spline) {
    const double inner = -3.0 + 2.25 * q, left = 2.0 - q, outer = -0.75 * left * left / q;
    const double either = q < 1.0 ? inner : outer;
    return q < 2.0 ? either : 0.0;
  } else {
    const double s = 1.0 - 0.5 * q, cubed = -5.0 * s * s * s;
    return q < 2.0 ? cubed : 0.0;
  }
}

template <int Dim> EFREE_INLINE double power_of(double over_h) {
  const double square = over_h * over_h;
  return Dim == 2 ? square * square : square * square * over_h;
}

/// W'(r) / r of all pairs, in the first column; with unequal smoothing lengths the mean of both, by the next two.
template <int Dim, SmoothingKernel kernel>
EFREE_INLINE void find_slopes(const ParticlePairs& pairs, const LocalParticles& of, PairColumns& columns) {
  const double norm = kernel_norm(kernel, Dim);
  const auto squared_distance = [&](Index i, Index j) {
    double sum = 0.0;
    for (int d = 0; d < Dim; ++d) {
      const double difference = of.x[4 * i + d] - of.x[4 * j + d];
      sum += difference * difference;
    }
    return sum;
  };
  const Index count = pairs.count();
  double* slopes = columns[slope];
  if (of.one_size) {
    const double over_h = of.x[3], scale = norm * power_of<Dim>(over_h);
    for_each_pair(pairs, [&](Index i, Index j, Index k) { slopes[k] = squared_distance(i, j); });
    for (Index k = 0; k < count; ++k) slopes[k] = scale * kernel_slope_by<kernel>(over_h * __builtin_sqrt(slopes[k]));
    return;
  }
  double *first = columns[approach], *second = columns[density];
  for_each_pair(pairs, [&](Index i, Index j, Index k) {
    slopes[k] = squared_distance(i, j);
    first[k] = of.x[4 * i + 3];
    second[k] = of.x[4 * j + 3];
  });
  for (Index k = 0; k < count; ++k) {
    const double r = __builtin_sqrt(slopes[k]), a = first[k], b = second[k];
    slopes[k] = 0.5 * norm *
                (power_of<Dim>(a) * kernel_slope_by<kernel>(a * r) + power_of<Dim>(b) * kernel_slope_by<kernel>(b * r));
  }
}
template <int Dim>
EFREE_INLINE void find_slopes(const ParticlePairs& pairs, const LocalParticles& of, PairColumns& columns) {
  if (of.kernel == SmoothingKernel::cubic_spline)
    find_slopes<Dim, SmoothingKernel::cubic_spline>(pairs, of, columns);
  else
    find_slopes<Dim, SmoothingKernel::wendland_c2>(pairs, of, columns);
}

/// Subtracts from four numbers in an array.
EFREE_INLINE void subtract(double* from, const Four& what) {
  Four value;
  load(value, from);
  value -= what;
  store(from, value);
}

/// slope times the outer product of two vectors, by columns.
template <int Dim> EFREE_INLINE void outer(double slope, const Four& a, const Four& b, Four* product) {
  if constexpr (Dim == 2) {
    product[0] = slope * Four{a[0], a[1], a[0], a[1]} * Four{b[0], b[0], b[1], b[1]};
  } else {
    for (int c = 0; c < 3; ++c) product[c] = slope * b[c] * a;
  }
}

template <int Dim, bool has_moments> EFREE_INLINE void sum_rates_of(const ParticlePairs& pairs,
                                                                    const LocalParticles& of, PairColumns& pair_columns,
                                                                    double* rates, double* moments) {
  find_slopes<Dim>(pairs, of, pair_columns);
  const double* slopes = pair_columns[slope];
  constexpr int columns = Dim == 2 ? 1 : 3, size = 4 * columns;
  for (Index k = 0; k < size * pairs.all(); ++k) rates[k] = 0.0;
  for (Index k = 0; has_moments && k < size * pairs.all(); ++k) moments[k] = 0.0;
  for (Index i = 0; i < pairs.own; ++i) {
    Four x, v, xj, vj, part[columns], sum[columns] = {}, moment[columns] = {};
    load(x, of.x + 4 * i);
    load(v, of.v + 4 * i);
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; ++k) {
      const Index j = pairs.other[k];
      load(xj, of.x + 4 * j);
      load(vj, of.v + 4 * j);
      const Four d = x - xj;
      outer<Dim>(slopes[k], v - vj, d, part);
      for (int c = 0; c < columns; ++c) {
        sum[c] += vj[3] * part[c];
        subtract(rates + size * j + 4 * c, v[3] * part[c]);
      }
      if constexpr (has_moments) {
        outer<Dim>(slopes[k], d, d, part);
        for (int c = 0; c < columns; ++c) {
          moment[c] += vj[3] * part[c];
          subtract(moments + size * j + 4 * c, v[3] * part[c]);
        }
      }
    }
    for (int c = 0; c < columns; ++c) {
      subtract(rates + size * i + 4 * c, sum[c]);
      if constexpr (has_moments) subtract(moments + size * i + 4 * c, moment[c]);
    }
  }
}

/// Pi of all pairs that approach each other, in the column `approach`, and v.x in the column `along`.
/// Returns the largest q.
template <int Dim> EFREE_INLINE double find_viscosity(const ParticlePairs& pairs, const LocalParticles& of,
                                                      const PairForces& by, PairColumns& columns) {
  double *pi = columns[approach], *rho = columns[density], *c = columns[sound], *dot = columns[along];
  for_each_pair(pairs, [&](Index i, Index j, Index k) {
    const double *x = of.x + 4 * i, *xj = of.x + 4 * j, *v = of.v + 4 * i, *vj = of.v + 4 * j;
    double sum = 0.0, squared = 0.0;
    for (int d = 0; d < Dim; ++d) {
      sum += (x[d] - xj[d]) * (v[d] - vj[d]);
      squared += (x[d] - xj[d]) * (x[d] - xj[d]);
    }
    dot[k] = sum;
    pi[k] = squared;
    rho[k] = by.density[2 * i] + by.density[2 * j];
    c[k] = by.density[2 * i + 1] + by.density[2 * j + 1];
  });
  const Index count = pairs.count();
  double least = 0.0;
  const auto evaluate = [&](Index k, double h) {
    const double q = h * (dot[k] < 0.0 ? dot[k] : 0.0) / (pi[k] + 0.01 * h * h);
    least = q < least ? q : least;
    pi[k] = q * (by.quadratic * q - 0.5 * by.linear * c[k]) / (0.5 * rho[k]);
  };
  if (of.one_size) {
    const double h = 1.0 / of.x[3];
    for (Index k = 0; k < count; ++k) evaluate(k, h);
  } else {
    for_each_pair(pairs, [&](Index i, Index j, Index k) { evaluate(k, 2.0 / (of.x[4 * i + 3] + of.x[4 * j + 3])); });
  }
  return -least;
}

/// (W(r) / W(reference))^exponent of all pairs, with the mean of their smoothing lengths.
template <int Dim>
void find_artificial(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by, double* factors) {
  const double reference = kernel_shape(of.kernel, by.reference);
  for (Index i = 0; i < pairs.own; ++i)
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; ++k) {
      const Index j = pairs.other[k];
      double sum = 0.0;
      for (int d = 0; d < Dim; ++d) {
        const double difference = of.x[4 * i + d] - of.x[4 * j + d];
        sum += difference * difference;
      }
      const double over_h = 0.5 * (of.x[4 * i + 3] + of.x[4 * j + 3]);
      factors[k] = std::pow(kernel_shape(of.kernel, over_h * std::sqrt(sum)) / reference, by.exponent);
    }
}

/// The sum of two tensors times a vector.
template <int Dim> EFREE_INLINE void multiply(const double* a, const double* b, const Four& d, Four& result) {
  result = Four{};
  for (int j = 0; j < (Dim == 2 ? 1 : 3); ++j) {
    Four of_a, of_b;
    load(of_a, a + 4 * j);
    load(of_b, b + 4 * j);
    if constexpr (Dim == 2) {
      const Four products = (of_a + of_b) * Four{d[0], d[0], d[1], d[1]};
      result = Four{products[0] + products[2], products[1] + products[3], 0.0, 0.0};
    } else {
      result += (of_a + of_b) * d[j];
    }
  }
}

template <int Dim, bool has_artificial, bool has_viscosity>
EFREE_INLINE LostPower sum_forces_of(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by,
                                     PairColumns& columns, double* forces) {
  const double *slopes = columns[slope], *pi = columns[approach], *dot = columns[along], *factor = columns[artificial];
  find_slopes<Dim>(pairs, of, columns);
  constexpr int size = tensor_size(Dim);
  for (Index k = 0; k < 4 * pairs.all(); ++k) forces[k] = 0.0;
  LostPower lost;
  if (has_viscosity) lost.approach = find_viscosity<Dim>(pairs, of, by, columns);
  for (Index i = 0; i < pairs.own; ++i) {
    Four x, v, xj, vj, of_pair, more, sum = {};
    load(x, of.x + 4 * i);
    load(v, of.v + 4 * i);
    for (Index k = pairs.begin[i]; k < pairs.begin[i + 1]; ++k) {
      const Index j = pairs.other[k];
      load(xj, of.x + 4 * j);
      load(vj, of.v + 4 * j);
      const Four d = x - xj;
      const double weight = v[3] * vj[3] * slopes[k], share = j < pairs.own ? 1.0 : 0.5;
      multiply<Dim>(by.stress + size * i, by.stress + size * j, d, of_pair);
      if constexpr (has_viscosity) {
        of_pair -= pi[k] * d;
        lost.viscous += share * weight * pi[k] * dot[k];
      }
      if constexpr (has_artificial) {
        multiply<Dim>(by.artificial + size * i, by.artificial + size * j, d, more);
        more *= factor[k];
        const Four power = more * (v - vj);
        lost.artificial -= share * weight * (power[0] + power[1] + power[2]);
        of_pair += more;
      }
      of_pair *= weight;
      sum += of_pair;
      subtract(forces + 4 * j, of_pair);
    }
    subtract(forces + 4 * i, -sum);
  }
  return lost;
}

EFREE_FOR_EACH_MACHINE void rates_kernel(const ParticlePairs& pairs, const LocalParticles& of, PairColumns& columns,
                                         double* rates, double* moments) {
  if (of.dim == 2)
    moments ? sum_rates_of<2, true>(pairs, of, columns, rates, moments)
            : sum_rates_of<2, false>(pairs, of, columns, rates, moments);
  else
    moments ? sum_rates_of<3, true>(pairs, of, columns, rates, moments)
            : sum_rates_of<3, false>(pairs, of, columns, rates, moments);
}

template <int Dim> EFREE_INLINE LostPower sum_forces_by(const ParticlePairs& pairs, const LocalParticles& of,
                                                        const PairForces& by, PairColumns& columns, double* forces) {
  const bool has_viscosity = by.linear > 0.0 || by.quadratic > 0.0;
  if (by.artificial)
    return has_viscosity ? sum_forces_of<Dim, true, true>(pairs, of, by, columns, forces)
                         : sum_forces_of<Dim, true, false>(pairs, of, by, columns, forces);
  return has_viscosity ? sum_forces_of<Dim, false, true>(pairs, of, by, columns, forces)
                       : sum_forces_of<Dim, false, false>(pairs, of, by, columns, forces);
}

EFREE_FOR_EACH_MACHINE LostPower forces_kernel(const ParticlePairs& pairs, const LocalParticles& of,
                                               const PairForces& by, PairColumns& columns, double* forces) {
  return of.dim == 2 ? sum_forces_by<2>(pairs, of, by, columns, forces)
                     : sum_forces_by<3>(pairs, of, by, columns, forces);
}

}  // namespace

void sum_rates(const ParticlePairs& pairs, const LocalParticles& of, double* rates, double* moments) {
  rates_kernel(pairs, of, columns_for(pairs), rates, moments);
}

LostPower sum_forces(const ParticlePairs& pairs, const LocalParticles& of, const PairForces& by, double* forces) {
  PairColumns& columns = columns_for(pairs);
  if (by.artificial) {
    if (of.dim == 2)
      find_artificial<2>(pairs, of, by, columns[artificial]);
    else
      find_artificial<3>(pairs, of, by, columns[artificial]);
  }
  return forces_kernel(pairs, of, by, columns, forces);
}

}  // namespace efree::internal
