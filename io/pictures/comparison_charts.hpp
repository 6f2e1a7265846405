// SPDX-License-Identifier: GPL-3.0-or-later
/// What a comparison of methods found, as charts.
#pragma once

#include "efree/analysis/comparison.hpp"
#include "efree/io/files/output_directory.hpp"

#include <string>

namespace efree {

/// Charts by gnuplot as SVG and PNG: probes (the error of each probe against CPU time; grey where methods disagree) and
/// energy (error of the energy balance against CPU time), and beside them the script charts.gp that draws them. Returns
/// an empty string, or why there are no charts (no gnuplot, no run that came to its end).
std::string write_charts(OutputDirectory& out, const Comparison& comparison);

}  // namespace efree
