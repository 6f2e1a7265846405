// SPDX-License-Identifier: GPL-3.0-or-later
/// Files by time, as ParaView reads them (.pvd).
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// Throws InputError if the file cannot be written. `frames`: times, and the names of files beside it.
void write_series(const std::filesystem::path& file, const std::vector<std::pair<double, std::string>>& frames);

}  // namespace efree::internal
