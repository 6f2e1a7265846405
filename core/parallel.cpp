// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/parallel.hpp"

#include "efree/core/error.hpp"

#include <omp.h>
#include <algorithm>
#include <exception>

namespace efree {

void set_num_threads(int threads) {
  require(threads >= 1, "number of threads must be at least 1");
  omp_set_num_threads(threads);
}

int num_threads() {
  return omp_get_max_threads();
}

void parallel_chunks(Index n, Index chunk, const std::function<void(Index, Index)>& body) {
  if (n <= 0) return;
  const Index chunks = (n - 1) / chunk + 1;
  Index failed_chunk = chunks;
  std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic, 1) if (chunks > 1)
  for (Index c = 0; c < chunks; ++c) {
    try {
      body(c * chunk, std::min<Index>(n, (c + 1) * chunk));
    } catch (...) {
#pragma omp critical(efree_parallel_failure)
      if (c < failed_chunk) {
        failed_chunk = c;
        failure = std::current_exception();
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
}

void on_one_thread(const std::function<void()>& work) {
  const int levels = omp_get_max_active_levels();
  omp_set_max_active_levels(0);
  try {
    work();
  } catch (...) {
    omp_set_max_active_levels(levels);
    throw;
  }
  omp_set_max_active_levels(levels);
}

}  // namespace efree
