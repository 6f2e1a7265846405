// SPDX-License-Identifier: GPL-3.0-or-later
/// Loops on several threads, the only place that knows threads. Work is cut into chunks that do not depend on the
/// number of threads, and every chunk writes to its own output, so results are bitwise the same on any number of
/// threads.
#pragma once

#include "efree/core/types.hpp"

#include <functional>

namespace efree {

/// Sets the number of threads that loops of the calling thread use, the caller included. Throws InputError below 1. It
/// begins as OpenMP's: OMP_NUM_THREADS, else the number of processors. BLAS always runs on one thread (its sums must
/// not depend on threads).
void set_num_threads(int threads);
/// Number of threads that loops of the calling thread use.
int num_threads();

/// Calls body(begin, end) on consecutive ranges that cover [0, n), each at most `chunk` long; ranges run concurrently,
/// but for those of a loop inside a loop. All ranges run; then the first exception (in range order) is rethrown. Put
/// scratch memory inside body: one allocation per chunk. Idle threads sleep: beside other work on the machine several
/// threads take no longer than one.
void parallel_chunks(Index n, Index chunk, const std::function<void(Index begin, Index end)>& body);

/// Calls body(i) for all i in [0, n), concurrently in chunks of 256.
template <class Body> void parallel_for(Index n, const Body& body) {
  parallel_chunks(n, 256, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) body(i);
  });
}

}  // namespace efree
