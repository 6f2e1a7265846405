// SPDX-License-Identifier: GPL-3.0-or-later
/// Long vectors and sums over them, bitwise the same on any number of threads.
#pragma once

#include "efree/core/parallel.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace efree::internal {

/// Memory is first written by those who fill it, in parallel: pages are handed out then.
template <class T> struct Uninitialised : std::allocator<T> {
  template <class U> struct rebind { using other = Uninitialised<U>; };
  template <class U, class... Arguments> void construct(U* at, Arguments&&... arguments) {
    if constexpr (sizeof...(Arguments) == 0)
      ::new (static_cast<void*>(at)) U;
    else
      ::new (static_cast<void*>(at)) U(std::forward<Arguments>(arguments)...);
  }
};
template <class T> using Values = std::vector<T, Uninitialised<T>>;
using Field = Values<double>;
using SingleField = Values<float>;

/// Entries that one thread takes at once.
inline constexpr Index field_chunk = 1 << 14;

/// Calls f(i) for all i in [0, size).
template <class F> void for_all(std::size_t size, const F& f) {
  parallel_chunks(static_cast<Index>((size + field_chunk - 1) / field_chunk), 1, [&](Index begin, Index end) {
    const std::size_t first = static_cast<std::size_t>(begin) * field_chunk,
                      last = std::min(size, static_cast<std::size_t>(end) * field_chunk);
    for (std::size_t i = first; i < last; ++i) f(i);
  });
}
/// Sum of f(i) over [0, size).
template <class F> double summed(std::size_t size, const F& f) {
  const Index chunks = static_cast<Index>((size + field_chunk - 1) / field_chunk);
  std::vector<double> part(chunks);
  parallel_chunks(chunks, 1, [&](Index begin, Index end) {
    for (Index c = begin; c < end; ++c) {
      const std::size_t first = static_cast<std::size_t>(c) * field_chunk, last = std::min(size, first + field_chunk);
      double sum = 0.0;
      for (std::size_t i = first; i < last; ++i) sum += f(i);
      part[c] = sum;
    }
  });
  double sum = 0.0;
  for (const double p : part) sum += p;
  return sum;
}
template <class T> Values<T> zeros(std::size_t size) {
  Values<T> result(size);
  for_all(size, [&](std::size_t i) { result[i] = T(0); });
  return result;
}
template <class A, class B> double dot(const Values<A>& a, const Values<B>& b) {
  return summed(a.size(), [&](std::size_t i) { return static_cast<double>(a[i]) * b[i]; });
}

/// A step of a smoother: step = keep * step + take * D^-1 (b - K x), then x += step.
struct SmoothingStep {
  float keep, take;
};
/// The polynomial of degree 2 that Chebyshev chooses for the upper part of the spectrum of D^-1 K, which ends at 1.
inline std::array<SmoothingStep, 2> chebyshev_steps() {
  constexpr double range = 8.0;  // upper over lower end of the part
  constexpr double high = 1.0, low = high / range, centre = 0.5 * (high + low), half = 0.5 * (high - low);
  constexpr double rho = half / centre, next = 1.0 / (2.0 * centre / half - rho);
  return {{{0.0F, static_cast<float>(1.0 / centre)},
           {static_cast<float>(next * rho), static_cast<float>(2.0 * next / half)}}};
}

}  // namespace efree::internal
