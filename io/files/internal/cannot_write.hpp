// SPDX-License-Identifier: GPL-3.0-or-later
/// What is said of a file that could not be written.
#pragma once

#include <filesystem>

namespace efree::internal {

/// Throws InputError that names the file, the folder it was to lie in, and whether there is room left there. Files in
/// the temporary folder of an OutputDirectory are said to lie in that directory.
[[noreturn]] void cannot_write(const std::filesystem::path& file);

}  // namespace efree::internal
