// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/parallel.hpp"
#include "efree/core/error.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>
#include <atomic>
#include <string>
#include <thread>
#include <vector>

namespace efree {
namespace {

/// Tests change the number of threads for themselves.
class Parallel : public ::testing::Test {
 protected:
  ~Parallel() override { set_num_threads(threads_); }

  /// How often a loop visits each of n numbers.
  static std::vector<int> visits(Index n, Index chunk) {
    std::vector<int> count(n, 0);
    parallel_chunks(n, chunk, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) ++count[i];
    });
    return count;
  }

 private:
  int threads_ = num_threads();
};

TEST_F(Parallel, ALoopVisitsEveryNumberOnce) {
  for (const int threads : {1, 2, 5}) {
    set_num_threads(threads);
    for (const Index n : {0, 1, 7, 1000})
      for (const Index chunk : {1, 3, 2000}) EXPECT_EQ(visits(n, chunk), std::vector<int>(n, 1)) << n << ' ' << chunk;
  }
}

TEST_F(Parallel, ManyLoopsInSuccessionLoseNothing) {
  set_num_threads(3);
  std::vector<Index> sums(8);
  for (int loop = 0; loop < 20000; ++loop) parallel_chunks(8, 1, [&](Index begin, Index) { sums[begin] += begin; });
  for (Index i = 0; i < 8; ++i) EXPECT_EQ(sums[i], 20000 * i);
}

TEST_F(Parallel, ChunksRunAtTheSameTimeOnAsManyThreadsAsWereSet) {
  set_num_threads(3);
  std::atomic<int> arrived = 0;
  parallel_chunks(3, 1, [&](Index, Index) {
    for (++arrived; arrived < 3;) std::this_thread::yield();  // each waits for the others
  });
  EXPECT_EQ(arrived, 3);
}

TEST_F(Parallel, ALoopInsideALoopRunsOnItsCallersThread) {
  set_num_threads(2);
  std::atomic<int> strangers = 0;
  parallel_chunks(4, 1, [&](Index, Index) {
    const auto own = std::this_thread::get_id();
    parallel_chunks(4, 1, [&](Index, Index) { strangers += std::this_thread::get_id() != own; });
  });
  EXPECT_EQ(strangers, 0);
}

TEST_F(Parallel, LoopsOfSeveralCallersRunBesideEachOther) {
  std::vector<std::vector<int>> counts(4);
  std::vector<std::thread> callers;
  for (auto& count : counts)
    callers.emplace_back([&count] {
      set_num_threads(2);
      for (int loop = 0; loop < 200; ++loop) count = visits(100, 7);
    });
  for (auto& caller : callers) caller.join();
  for (const auto& count : counts) EXPECT_EQ(count, std::vector<int>(100, 1));
}

TEST_F(Parallel, TheFirstExceptionInTheOrderOfRangesIsThrownAfterAllHaveRun) {
  for (const int threads : {1, 3}) {
    set_num_threads(threads);
    std::atomic<int> ran = 0;
    try {
      parallel_chunks(20, 1, [&](Index begin, Index) {
        ++ran;
        if (begin % 5 == 3) throw InputError(std::to_string(begin));
      });
      ADD_FAILURE() << "nothing was thrown";
    } catch (const InputError& error) {
      EXPECT_STREQ(error.what(), "3");
    }
    EXPECT_EQ(ran, 20);
  }
}

TEST_F(Parallel, AForkedChildHasThreadsOfItsOwn) {
  set_num_threads(2);
  EXPECT_EQ(visits(100, 1), std::vector<int>(100, 1));
  const pid_t child = fork();
  if (child == 0) {
    std::atomic<int> arrived = 0;
    parallel_chunks(2, 1, [&](Index, Index) {
      for (++arrived; arrived < 2;) std::this_thread::yield();
    });
    _exit(visits(100, 1) == std::vector<int>(100, 1) ? 0 : 1);
  }
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

TEST_F(Parallel, FewerThanOneThreadIsRefused) {
  EXPECT_THROW(set_num_threads(0), InputError);
}

}  // namespace
}  // namespace efree
