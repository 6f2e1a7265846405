// SPDX-License-Identifier: GPL-3.0-or-later
/// Time that this process has had.
#pragma once

#include "efree/core/internal/clock.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

namespace efree::bench {

/// CPU seconds of all threads so far.
inline double cpu_seconds() {
  return internal::process_cpu_seconds();
}

/// Seconds by the clock, since some time.
inline double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Seconds of the processor on one thread, whatever else runs beside it; on several, by the clock.
inline double seconds() {
  return num_threads() == 1 ? cpu_seconds() : wall_seconds();
}

/// The middle one, of an even number the upper of the two.
inline double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

/// Median of the CPU seconds that something takes.
template <class F> double median_cpu(int repetitions, const F& run) {
  std::vector<double> spent;
  for (int k = 0; k < repetitions; ++k) {
    const double start = cpu_seconds();
    run();
    spent.push_back(cpu_seconds() - start);
  }
  return median(std::move(spent));
}

}  // namespace efree::bench
