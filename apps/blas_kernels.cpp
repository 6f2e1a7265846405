// SPDX-License-Identifier: GPL-3.0-or-later
#include "blas_kernels.hpp"

#include <sys/resource.h>
#include <unistd.h>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

extern "C" {
char* openblas_get_corename();
// Of builds that choose kernels by the processor: forgets the choice, and chooses.
[[gnu::weak]] void gotoblas_dynamic_quit();
[[gnu::weak]] void gotoblas_dynamic_init();
}

namespace efree {

namespace {

constexpr const char* kernels = "OPENBLAS_CORETYPE";
constexpr const char* blas_threads = "OPENBLAS_NUM_THREADS";

/// Whether OpenBLAS takes this processor for the oldest it knows.
bool is_unknown() {
  return std::string_view(openblas_get_corename()) == "Prescott";
}
/// Kernels that suit this processor better than those OpenBLAS has chosen; none if it has chosen well.
const char* better_kernels() {
#if defined(__x86_64__)
  if (std::getenv(kernels) != nullptr || !is_unknown()) return nullptr;
  const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                          __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
  const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (has_avx2) return has_avx512 ? "SkylakeX" : "Haswell";
#endif
  return nullptr;
}

bool is_limited() {
  rlimit addresses{}, data{};
  return getrlimit(RLIMIT_AS, &addresses) == 0 && getrlimit(RLIMIT_DATA, &data) == 0 &&
         (addresses.rlim_cur != RLIM_INFINITY || data.rlim_cur != RLIM_INFINITY);
}

}  // namespace

void choose_fast_blas(char** argv) {
  const char* wanted = better_kernels();
  const bool spares_threads = is_limited() && std::getenv(blas_threads) == nullptr;
  if (wanted == nullptr && !spares_threads) return;
  std::error_code unknown;
  const std::string running = std::filesystem::read_symlink("/proc/self/exe", unknown).filename();
  for (const char* other : {"ld-", "qemu", "memcheck"})  // a loader or an emulator that runs the program
    if (running.starts_with(other)) return;
  if (wanted != nullptr && setenv(kernels, wanted, 1) != 0) return;
  if (!spares_threads && gotoblas_dynamic_quit != nullptr && gotoblas_dynamic_init != nullptr) {
    gotoblas_dynamic_quit();
    gotoblas_dynamic_init();
    if (!is_unknown()) return;
  }
  if (setenv(blas_threads, "1", 1) != 0) return;
  execv("/proc/self/exe", argv);
}

}  // namespace efree
