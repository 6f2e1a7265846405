// SPDX-License-Identifier: GPL-3.0-or-later
/// The kinds of failure a caller can meet. Our own bugs are asserts.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace efree {

/// Bad input: the message names the value, the place and what was expected. Exit status 2 on the command line.
struct InputError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

/// A computation that cannot go on although its input was well formed. Exit status 3 on the command line.
struct NumericalError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Whoever watches a run (Monitor::cancelled) ended it, in this stage.
struct Cancelled : std::runtime_error {
  explicit Cancelled(std::string in)
      : std::runtime_error("cancelled in the stage \"" + in + "\""), stage(std::move(in)) {}
  std::string stage;
};

/// Throws InputError(message) unless `condition` holds. For cheap messages; build dear ones only on failure.
inline void require(bool condition, const char* message) {
  if (!condition) throw InputError(message);
}

}  // namespace efree
