// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/memory.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <fstream>
#include <limits>
#include <string>

namespace efree {

double available_memory() {
  std::ifstream file("/proc/meminfo");
  std::string key, unit;
  for (double kilobytes; file >> key >> kilobytes && std::getline(file, unit);)
    if (key == "MemAvailable:") return 1024.0 * kilobytes;
  return std::numeric_limits<double>::infinity();
}

void require_memory(double bytes, std::string_view what, std::string_view advice) {
  if (const double available = available_memory(); !(bytes <= available))
    throw InputError(fmt::format("{} takes about {:.3g} GiB of memory, {:.3g} GiB are available{}{}", what,
                                 bytes / 0x1p30, available / 0x1p30, advice.empty() ? "" : "; ", advice));
}

void return_freed_memory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace efree
