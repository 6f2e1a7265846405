// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/internal/reading_bound.hpp"

#include "efree/core/memory.hpp"

#include <sys/resource.h>
#include <sys/time.h>
#include <cmath>
#include <filesystem>

namespace efree::internal {

bool ReadingBound::own_process = false;

ReadingBound::ReadingBound(const std::string& file) {
  std::error_code unknown;
  const auto length = std::filesystem::file_size(file, unknown);
  rlimit data{};
  if (!own_process || unknown || getrlimit(RLIMIT_DATA, &data) != 0) return;
  const double bound = data_memory() + 0x1p28 + 200.0 * static_cast<double>(length);
  if (bound >= static_cast<double>(data.rlim_cur)) return;
  const rlimit lower{static_cast<rlim_t>(bound), data.rlim_max};
  if (setrlimit(RLIMIT_DATA, &lower) == 0) before_ = data.rlim_cur;
}

ReadingBound::~ReadingBound() {
  rlimit data{};
  if (before_ == 0 || getrlimit(RLIMIT_DATA, &data) != 0) return;
  data.rlim_cur = before_;
  setrlimit(RLIMIT_DATA, &data);
}

bool ReadingTime::limited = false;

ReadingTime::ReadingTime(const std::string& file, double seconds) {
  std::error_code unknown;
  const auto length = std::filesystem::file_size(file, unknown);
  if (!limited || unknown) return;
  const double bound = seconds * (1.0 + 1e-6 * static_cast<double>(length));
  itimerval timer{};
  timer.it_value.tv_sec = static_cast<time_t>(bound);
  timer.it_value.tv_usec = static_cast<suseconds_t>(1e6 * (bound - std::floor(bound)));
  is_set_ = setitimer(ITIMER_PROF, &timer, nullptr) == 0;
}

ReadingTime::~ReadingTime() {
  constexpr itimerval none{};
  if (is_set_) setitimer(ITIMER_PROF, &none, nullptr);
}

}  // namespace efree::internal
