// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/core/concurrently.hpp"

#include "efree/core/parallel.hpp"

#include <future>

namespace efree {

void concurrently(const std::function<void()>& beside, const std::function<void()>& work) {
  if (num_threads() == 1) {
    beside();
    work();
    return;
  }
  // Its destructor waits, should work() throw.
  std::future<void> other = std::async(std::launch::async, [&] {
    set_num_threads(1);  // of that thread
    beside();
  });
  work();
  other.get();
}

}  // namespace efree
