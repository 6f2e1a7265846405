// SPDX-License-Identifier: GPL-3.0-or-later
/// `efree cracks`: meshes of the cracks of a finished run.
#pragma once

#include "display.hpp"
#include "efree/io/records/crack_files.hpp"

#include <optional>
#include <string>

namespace efree {

struct CrackRunOptions {
  std::string run{};                 ///< directory of the results of efree run
  std::optional<std::string> out{};  ///< directory; by default `cracks` in that
  CrackFileOptions files{};
};

/// Writes the files of write_cracks, then the table to the terminal. Throws InputError.
void run_cracks(const CrackRunOptions& options, bool quiet, Display& display);

}  // namespace efree
