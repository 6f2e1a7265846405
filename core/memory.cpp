// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/memory.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <algorithm>
#include <cstdint>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>
#include <string>

namespace efree {

namespace {

constexpr double unlimited = std::numeric_limits<double>::infinity();

/// The number that follows a word in a file of such pairs, or `otherwise`.
double value_of(const std::string& word, const std::string& file, double otherwise) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    std::string key;
    if (double value = 0.0; words >> key >> value && key == word) return value;
  }
  return otherwise;
}

/// The number that a file begins with, or `otherwise`.
double number_in(const std::string& file, double otherwise) {
  std::ifstream stream(file);
  double value = 0.0;
  return stream >> value ? value : otherwise;
}

/// Where a version of control groups keeps its numbers.
struct GroupFiles {
  const char *root, *limit, *used, *cached;
};
constexpr GroupFiles version_1{"/sys/fs/cgroup/memory", "/memory.limit_in_bytes", "/memory.usage_in_bytes",
                               "total_inactive_file"};
constexpr GroupFiles version_2{"/sys/fs/cgroup", "/memory.max", "/memory.current", "inactive_file"};

/// What the control groups that this process is in leave of their limits. Files that are cached can go.
double available_to_group() {
  std::ifstream file("/proc/self/cgroup");
  double least = unlimited;
  for (std::string line; std::getline(file, line);) {
    const bool first = line.find(":memory:/") != std::string::npos;
    if (!first && !line.starts_with("0::/")) continue;
    const GroupFiles& files = first ? version_1 : version_2;
    std::string group = line.substr(line.find(":/") + 1);
    while (true) {
      const std::string folder = files.root + group;
      const double used = number_in(folder + files.used, 0.0);
      const double cached = value_of(files.cached, folder + "/memory.stat", 0.0);
      least = std::min(least, number_in(folder + files.limit, unlimited) - used + cached);
      if (group.empty()) break;
      group.erase(group.rfind('/'));
    }
  }
  return least;
}

/// Of this kind of memory, of which so much is used.
double left_of(int kind, double used) {
  rlimit limit{};
  if (getrlimit(static_cast<__rlimit_resource>(kind), &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return unlimited;
  return static_cast<double>(limit.rlim_cur) - used;
}

}  // namespace

double data_memory() {
  return 1024.0 * value_of("VmData:", "/proc/self/status", 0.0);
}

double available_memory() {
  const double of_system = 1024.0 * value_of("MemAvailable:", "/proc/meminfo", unlimited);
  const double addresses = 1024.0 * value_of("VmSize:", "/proc/self/status", 0.0);
  return std::max(0.0, std::min({of_system, available_to_group(), left_of(RLIMIT_AS, addresses),
                                 left_of(RLIMIT_DATA, data_memory())}));
}

void require_memory(double bytes, std::string_view what, std::string_view advice) {
  if (const double available = available_memory(); !(bytes <= available))
    throw InputError(fmt::format("{} takes about {:.3g} GiB of memory, {:.3g} GiB are available{}{}", what,
                                 bytes / 0x1p30, available / 0x1p30, advice.empty() ? "" : "; ", advice));
}

void require_blas_memory() {
  const std::size_t bytes = ((std::size_t{128} << 20U) + (std::size_t{1} << 16U)) * num_threads();
  void* room = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (room == MAP_FAILED)
    throw InputError(fmt::format(
        "factorisation takes {} MiB of addresses for {} threads, which this process may not have; raise its limit{}",
        bytes >> 20U, num_threads(), num_threads() > 1 ? " or take fewer threads (--threads 1)" : ""));
  munmap(room, bytes);
}

void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, (1 << 30) + ((1 << 30) - 1));
#endif
}

void move_to_large_pages(std::span<const std::span<const std::byte>> tables) {
  constexpr std::uintptr_t page = std::uintptr_t{2} << 20U;
  constexpr int collapse = 25;  // MADV_COLLAPSE, of which older headers do not know
  std::set<std::uintptr_t> pages;
  for (const auto& table : tables) {
    const auto begin = reinterpret_cast<std::uintptr_t>(table.data());
    for (std::uintptr_t at = begin / page * page; at < begin + table.size(); at += page) pages.insert(at);
  }
  // Where part of a page is not ours it stays as it is; a system that has none to give is not asked for all of them.
  int refused = 0;
  for (const std::uintptr_t at : pages)
    if (madvise(reinterpret_cast<void*>(at), page, collapse) != 0 && ++refused == 16) return;
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace efree
