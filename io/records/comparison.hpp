// SPDX-License-Identifier: GPL-3.0-or-later
/// What a comparison of methods found, as files and text.
#pragma once

#include "efree/analysis/comparison.hpp"

#include <filesystem>
#include <string>

namespace efree {

/// A line for each run, with its probes, their errors, time, energy error and why it failed. Throws InputError if the
/// file cannot be written.
void write_comparison_csv(const std::filesystem::path& file, const Comparison& comparison);
/// The same with references, their uncertainty and warnings.
void write_comparison_json(const std::filesystem::path& file, const std::string& title, const Comparison& comparison);
/// A table of them, and below it references, failures and warnings, a line each.
std::string comparison_table(const Comparison& comparison);

}  // namespace efree
