// SPDX-License-Identifier: GPL-3.0-or-later
/// Work on files that others wrote, in a process that can do no harm.
#pragma once

#include "efree/core/packer.hpp"
#include "efree/io/confined/reading.hpp"

#include <functional>
#include <string>

namespace efree::internal {

/// What work in a child process is called, and what it may do.
struct Confinement {
  std::string subject{};  ///< what is read or made: messages begin with it
  std::string reader{};   ///< who reads it: messages name it
  Reading limits{};
};

/// Runs `work` in a child process and returns the bytes it returned. The child has as many threads as its parent, and
/// as much memory as there is when it starts (available_memory). Unless trusted it can read files, but neither write
/// them nor start processes, reach the network or signal others (seccomp, which has to be there). Work that asks for a
/// child itself is simply done. Not to be called by two threads at once. While it waits it calls `watch`, if there is
/// one, ten times a second; whatever that throws ends the child.
///
/// Throws InputError and NumericalError as `work` does; InputError "subject: ..." that names the reader if it threw
/// anything else, if it took more memory or time than it may, or if it died, saying of what.
std::string run_confined(const Confinement& confinement, const std::function<std::string()>& work,
                         const std::function<void()>& watch = {});

/// The same with a value of any type that Packer takes (transfer.hpp has `fields` of meshes and images).
template <class Work>
auto confined(const Confinement& confinement, const Work& work, const std::function<void()>& watch = {}) {
  const auto packed = [&] {
    auto value = work();
    Packer pack;
    pack(value);
    return std::move(pack).bytes();
  };
  const std::string bytes = run_confined(confinement, packed, watch);
  decltype(work()) value{};
  Unpacker{bytes}(value);
  return value;
}

}  // namespace efree::internal
