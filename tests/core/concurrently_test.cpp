// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/concurrently.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gtest/gtest.h>
#include <chrono>
#include <future>
#include <string>
#include <thread>

namespace efree {
namespace {

/// Tests change the number of threads for themselves.
class Concurrently : public ::testing::Test {
 protected:
  ~Concurrently() override { set_num_threads(threads_); }

 private:
  int threads_ = num_threads();
};

TEST_F(Concurrently, BothRunAtTheSameTimeOnTwoThreads) {
  set_num_threads(2);
  std::promise<void> first, second;  // each waits for the other
  int threads_beside = 0;
  concurrently(
      [&] {
        threads_beside = num_threads();
        first.set_value();
        second.get_future().wait();
      },
      [&] {
        first.get_future().wait();
        second.set_value();
      });
  EXPECT_EQ(threads_beside, 1);
  EXPECT_EQ(num_threads(), 2);
}

TEST_F(Concurrently, OneAfterTheOtherOnOneThread) {
  set_num_threads(1);
  const auto own = std::this_thread::get_id();
  std::string order;
  concurrently(
      [&] {
        EXPECT_EQ(std::this_thread::get_id(), own);
        order += "beside ";
      },
      [&] { order += "work"; });
  EXPECT_EQ(order, "beside work");
}

TEST_F(Concurrently, AFailureOfEitherIsThrownWhenBothHaveEnded) {
  for (const int threads : {1, 2}) {
    set_num_threads(threads);
    EXPECT_THROW(concurrently([] { throw InputError("beside"); }, [] {}), InputError);
    EXPECT_THROW(concurrently([] {}, [] { throw NumericalError("work"); }), NumericalError);
    bool ended = false;
    if (threads == 2) {
      EXPECT_THROW(concurrently(
                       [&] {
                         std::this_thread::sleep_for(std::chrono::milliseconds(20));
                         ended = true;
                       },
                       [] { throw NumericalError("work"); }),
                   NumericalError);
      EXPECT_TRUE(ended);
    }
  }
}

}  // namespace
}  // namespace efree
