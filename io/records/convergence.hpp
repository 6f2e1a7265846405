// SPDX-License-Identifier: GPL-3.0-or-later
/// What a convergence study found, as files.
#pragma once

#include "efree/analysis/study.hpp"

#include <filesystem>
#include <string>

namespace efree {

/// One line per row.
void write_study_csv(const std::filesystem::path& file, const Study& study);
/// Observed orders and medians per method.
void write_study_json(const std::filesystem::path& file, const std::string& title, const Study& study);
/// Observed orders as a table for reading.
std::string order_table(const Study& study);

}  // namespace efree
