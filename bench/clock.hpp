// SPDX-License-Identifier: GPL-3.0-or-later
/// Time that this process has had.
#pragma once

#include "efree/core/parallel.hpp"

#include <chrono>
#include <ctime>

namespace efree::bench {

/// CPU seconds of all threads so far.
inline double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Seconds by the clock, since some time.
inline double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Seconds of the processor on one thread, whatever else runs beside it; on several, by the clock.
inline double seconds() {
  return num_threads() == 1 ? cpu_seconds() : wall_seconds();
}

}  // namespace efree::bench
