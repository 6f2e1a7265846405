// SPDX-License-Identifier: GPL-3.0-or-later
/// The only place that knows OpenMP. Work is cut into chunks that do not depend on the number of threads, and every
/// chunk writes to its own output, so results are bitwise the same on any number of threads.
#pragma once

#include "efree/core/types.hpp"

#include <functional>

namespace efree {

/// Number of threads used by parallel_for from now on, at least 1. BLAS always runs on one (its sums must not depend on
/// threads).
void set_num_threads(int threads);
int num_threads();  ///< threads that parallel_for uses

/// Calls body(begin, end) on consecutive ranges that cover [0, n), each at most `chunk` long; ranges run concurrently.
/// The first exception (in range order) is rethrown. Put scratch memory inside body: one allocation per chunk.
void parallel_chunks(Index n, Index chunk, const std::function<void(Index begin, Index end)>& body);

/// Calls work() with the threads of libraries that it calls held back: CHOLMOD asks for four of them at every small
/// block of a factor, however many there are to be, and they only wait for each other.
void on_one_thread(const std::function<void()>& work);

/// Calls body(i) for all i in [0, n), concurrently in chunks of 256.
template <class Body> void parallel_for(Index n, const Body& body) {
  parallel_chunks(n, 256, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) body(i);
  });
}

}  // namespace efree
