// SPDX-License-Identifier: GPL-3.0-or-later
/// What a convergence study found, as files and charts.
#pragma once

#include "efree/analysis/study.hpp"
#include "efree/io/files/output_directory.hpp"

#include <filesystem>
#include <string>

namespace efree {

/// One line per row.
void write_study_csv(const std::filesystem::path& file, const Study& study);
/// Observed orders and medians per method.
void write_study_json(const std::filesystem::path& file, const std::string& title, const Study& study);
/// Observed orders as a table for reading.
std::string order_table(const Study& study);

/// Charts by gnuplot as SVG and PNG: convergence (error against number of nodes, slope triangles), error_against_time,
/// stages (where the time goes), and beside them the script charts.gp that draws them. Returns an empty string, or why
/// there are no charts (no gnuplot).
std::string write_charts(OutputDirectory& out, const Study& study);

}  // namespace efree
