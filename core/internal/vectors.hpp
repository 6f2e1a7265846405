// SPDX-License-Identifier: GPL-3.0-or-later
/// Eight numbers at a time, or four. Sums of eight have eight partial sums on every machine.
#pragma once

#include <cstdint>
#include <cstring>

/// A function that is compiled for several instruction sets, the newest of which the processor has is taken where it
/// runs; what it calls has to be inlined. EFREE_AVX2_KERNELS and EFREE_SSE2_KERNELS leave out newer ones, so that tests
/// can show on one processor what others compute. Sanitizers do not know such functions.
#if !defined(__x86_64__) || !defined(__GNUC__) || defined(__clang__) || defined(__SANITIZE_ADDRESS__)
#define EFREE_FOR_EACH_MACHINE
#elif defined(EFREE_SSE2_KERNELS)
#define EFREE_FOR_EACH_MACHINE __attribute__((flatten))
#elif defined(EFREE_AVX2_KERNELS)
#define EFREE_FOR_EACH_MACHINE __attribute__((target_clones("arch=x86-64-v3", "default"), flatten))
#else
#define EFREE_FOR_EACH_MACHINE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default"), flatten))
#endif
#define EFREE_INLINE inline __attribute__((always_inline))

namespace efree::internal {

using Eight = double __attribute__((vector_size(64)));
using Four = double __attribute__((vector_size(32)));
using EightIntegers = std::int64_t __attribute__((vector_size(64)));

template <class V> EFREE_INLINE void load(V& to, const double* from) {
  std::memcpy(&to, from, sizeof to);
}
template <class V> EFREE_INLINE void store(double* to, const V& from) {
  std::memcpy(to, &from, sizeof from);
}
EFREE_INLINE double sum(const Eight& v) {
  return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}
EFREE_INLINE double largest(const Eight& v) {
  double m = v[0];
  for (int i = 1; i < 8; ++i) m = v[i] > m ? v[i] : m;
  return m;
}

/// exp(x) for x <= 0, to a unit in the last place or two; 0 below -700: x = k ln 2 + r, |r| <= ln(2) / 2, and Taylor's
/// series of exp(r) to r^12 / 12!.
EFREE_INLINE void exp_of_negative(Eight& x) {
  const EightIntegers tiny = x < -700.0;
  x = tiny ? x - x - 700.0 : x;
  const double shift = 0x1.8p52;
  const Eight shifted = x * 0x1.71547652b82fep0 + shift;
  const Eight k = shifted - shift;
  const Eight r = (x - k * 0x1.62e42fefa3800p-1) - k * 0x1.ef35793c76730p-45;
  Eight e = r * (1.0 / 479001600.0) + 1.0 / 39916800.0;
  e = e * r + 1.0 / 3628800.0;
  e = e * r + 1.0 / 362880.0;
  e = e * r + 1.0 / 40320.0;
  e = e * r + 1.0 / 5040.0;
  e = e * r + 1.0 / 720.0;
  e = e * r + 1.0 / 120.0;
  e = e * r + 1.0 / 24.0;
  e = e * r + 1.0 / 6.0;
  e = e * r + 0.5;
  e = e * r + 1.0;
  e = e * r + 1.0;
  EightIntegers bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  bits = (bits + 1023) << 52;
  Eight power;
  std::memcpy(&power, &bits, sizeof power);
  e *= power;
  x = tiny ? e - e : e;
}

}  // namespace efree::internal
