// SPDX-License-Identifier: GPL-3.0-or-later
/// Time that has passed.
#pragma once

#include <chrono>
#include <ctime>

namespace efree::internal {

/// Wall-clock seconds since it was made.
class Stopwatch {
 public:
  double operator()() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// CPU seconds of all threads since the program began.
inline double process_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace efree::internal
