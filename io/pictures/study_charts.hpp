// SPDX-License-Identifier: GPL-3.0-or-later
/// What a convergence study found, as charts.
#pragma once

#include "efree/analysis/study.hpp"
#include "efree/io/files/output_directory.hpp"

#include <string>

namespace efree {

/// Charts by gnuplot as SVG and PNG: convergence (error against number of nodes, slope triangles), error_against_time,
/// stages (where the time goes), and beside them the script charts.gp that draws them. Returns an empty string, or why
/// there are no charts (no gnuplot).
std::string write_charts(OutputDirectory& out, const Study& study);

}  // namespace efree
