// SPDX-License-Identifier: GPL-3.0-or-later
/// Leaving nothing behind when the user stops the program.
#pragma once

#include <array>
#include <functional>
#include <thread>

namespace efree {

/// While it lives, SIGINT (Ctrl-C), SIGTERM and SIGHUP run `clean_up`, on a thread of its own, before they end the
/// program; those that are ignored stay so. One at a time.
class OnInterrupt {
 public:
  explicit OnInterrupt(std::function<void()> clean_up);
  ~OnInterrupt();
  OnInterrupt(const OnInterrupt&) = delete;
  OnInterrupt& operator=(const OnInterrupt&) = delete;

 private:
  std::array<int, 2> pipe_{-1, -1};  ///< from the signal's handler, which may do next to nothing, to the thread
  std::thread watcher_;
};

}  // namespace efree
