// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/parallel.hpp"

#include "efree/core/error.hpp"

#include <omp.h>
#include <pthread.h>
#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace efree {
namespace {

/// A loop whose chunks threads claim one by one.
struct Loop {
  const std::function<void(Index, Index)>& body;
  Index n, chunk, chunks;
  int threads;                     ///< what num_threads() returns in the body
  int places;                      ///< workers that may still join; guarded by the team's mutex
  std::atomic<int> inside{0};      ///< workers that have joined and not left; changed under the team's mutex
  std::condition_variable left{};  ///< notified when the last worker leaves
  std::atomic<Index> next{0};      ///< first chunk that nobody has claimed
  std::mutex failure_mutex{};
  Index failed = chunks;  ///< first chunk that threw, and what
  std::exception_ptr failure{};

  void run_chunks() {
    for (Index c; (c = next.fetch_add(1, std::memory_order_relaxed)) < chunks;) {
      try {
        body(c * chunk, std::min<Index>(n, (c + 1) * chunk));
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (c < failed) {
          failed = c;
          failure = std::current_exception();
        }
      }
    }
  }
};

thread_local bool is_inside_loop = false;  // a loop within a loop runs on its caller's thread

/// Checks a condition for about 20 us, so that loops in close succession need no system calls. Longer active waiting
/// would take processor time from other work on the machine.
template <class Condition> bool spin_until(const Condition& condition) {
  for (int i = 0; i < 1000; ++i) {
    if (condition()) return true;
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }
  return false;
}

/// Worker threads that join open loops. The caller works on its own loop and at its end waits only for workers that
/// have joined: a worker that the operating system has not yet scheduled delays nobody. The barrier at the end of an
/// OpenMP loop waits for every thread of the team; on a busy machine each such wait can take a time slice.
class Team {
 public:
  static Team& get() {
    if (current == nullptr) {
      static std::once_flag once;
      std::call_once(once, [] {
        current = new Team;
        pthread_atfork(nullptr, nullptr, [] { current = new Team; });  // a forked child has none of the workers
      });
    }
    return *current;
  }

  void run(Loop& loop) {
    std::unique_lock lock(mutex_);
    add_workers(loop.places);
    open_.push_back(&loop);
    opened_.fetch_add(1, std::memory_order_release);
    const int sleepers = std::min(asleep_, loop.places);
    lock.unlock();
    for (int i = 0; i < sleepers; ++i) wake_.notify_one();
    {
      const InsideLoop inside;
      loop.run_chunks();
    }
    lock.lock();
    std::erase(open_, &loop);
    const auto is_done = [&] { return loop.inside.load(std::memory_order_relaxed) == 0; };
    if (is_done()) return;
    lock.unlock();
    spin_until(is_done);
    lock.lock();
    loop.left.wait(lock, is_done);
  }

 private:
  /// Marks this thread as inside a loop; libraries that it calls open no OpenMP teams of their own there.
  struct InsideLoop {
    int levels = omp_get_max_active_levels();
    InsideLoop() {
      is_inside_loop = true;
      omp_set_max_active_levels(0);
    }
    ~InsideLoop() {
      is_inside_loop = false;
      omp_set_max_active_levels(levels);
    }
    InsideLoop(const InsideLoop&) = delete;
    InsideLoop& operator=(const InsideLoop&) = delete;
  };

  void add_workers(int wanted) {
    for (; workers_ < wanted; ++workers_) {
      try {
        std::thread([this] { serve(); }).detach();
      } catch (const std::system_error&) {
        return;  // fewer threads come to the same result
      }
    }
  }

  Loop* join_open_loop() {
    for (Loop* loop : open_)
      if (loop->places > 0 && loop->next.load(std::memory_order_relaxed) < loop->chunks) {
        --loop->places;
        ++loop->inside;
        return loop;
      }
    return nullptr;
  }

  [[noreturn]] void serve() {
    const InsideLoop inside;
    std::unique_lock lock(mutex_);
    for (;;) {
      if (Loop* loop = join_open_loop()) {
        lock.unlock();
        omp_set_num_threads(loop->threads);
        loop->run_chunks();
        lock.lock();
        if (--loop->inside == 0) loop->left.notify_one();
        continue;
      }
      const std::uint64_t seen = opened_.load(std::memory_order_relaxed);
      const auto has_opened = [&] { return opened_.load(std::memory_order_acquire) != seen; };
      lock.unlock();
      const bool found = spin_until(has_opened);
      lock.lock();
      if (found) continue;
      ++asleep_;
      wake_.wait(lock, has_opened);
      --asleep_;
    }
  }

  static inline Team* current = nullptr;  // never destroyed: its workers end with the process

  std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<Loop*> open_;
  std::atomic<std::uint64_t> opened_{0};  ///< loops so far
  int workers_ = 0, asleep_ = 0;
};

}  // namespace

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
  const int threads = num_threads();
  Loop loop{.body = body,
            .n = n,
            .chunk = chunk,
            .chunks = chunks,
            .threads = threads,
            .places = static_cast<int>(std::min<Index>(threads, chunks)) - 1};
  if (loop.places == 0 || is_inside_loop)
    loop.run_chunks();
  else
    Team::get().run(loop);
  if (loop.failure) std::rethrow_exception(loop.failure);
}

}  // namespace efree
