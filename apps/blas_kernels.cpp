// SPDX-License-Identifier: GPL-3.0-or-later
#include "blas_kernels.hpp"

#include <unistd.h>
#include <cstdlib>
#include <string_view>

extern "C" char* openblas_get_corename();

namespace efree {

void restart_with_fast_blas(char** argv) {
#if defined(__x86_64__) && defined(__linux__)
  constexpr const char* variable = "OPENBLAS_CORETYPE";
  if (std::getenv(variable) != nullptr || std::string_view(openblas_get_corename()) != "Prescott") return;
  const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                          __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
  const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (!has_avx2 || setenv(variable, has_avx512 ? "SkylakeX" : "Haswell", 1) != 0) return;
  execv("/proc/self/exe", argv);
#else
  static_cast<void>(argv);
#endif
}

}  // namespace efree
