// SPDX-License-Identifier: GPL-3.0-or-later
/// Other programs that draw for us.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace efree {

/// Runs a program (found on PATH unless its name holds a slash) in a folder and waits for it. What it says on stdout
/// and stderr is put into `output` if that is given, and lost otherwise. Returns its exit status, 127 if there is no
/// such program, 128 plus the signal that ended it.
int run_program(const std::filesystem::path& folder, std::vector<std::string> command, std::string* output = nullptr);

}  // namespace efree
