// SPDX-License-Identifier: GPL-3.0-or-later
/// Runs that have to be the same on any number of threads and from a state.
#pragma once

#include "efree/core/parallel.hpp"

#include <string>

namespace efree::test {

/// What made() is at the time `end`, by that many threads; if it breaks off at the time `middle`, what again() is, from
/// the state then.
template <class Make, class Again>
auto run_in_two(int threads, bool breaks_off, double middle, double end, const Make& made, const Again& again) {
  const int before = num_threads();
  set_num_threads(threads);
  auto dynamics = made();
  dynamics.run(middle);
  if (breaks_off) {
    const std::string state = dynamics.state();
    dynamics = again();
    dynamics.restore(state);
  }
  dynamics.run(end);
  set_num_threads(before);
  return dynamics;
}
template <class Make> auto run_in_two(int threads, bool breaks_off, double middle, double end, const Make& made) {
  return run_in_two(threads, breaks_off, middle, end, made, made);
}

}  // namespace efree::test
