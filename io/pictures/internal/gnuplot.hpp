// SPDX-License-Identifier: GPL-3.0-or-later
/// Charts by gnuplot: what their scripts have in common.
#pragma once

#include "efree/io/files/output_directory.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace efree::internal {

/// Text for gnuplot's enhanced mode inside double quotes, where gnuplot would run what stands between backquotes.
std::string quoted(const std::string& text);

/// Smallest and largest of positive values, with a margin for axes.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = 0.0;
  void cover(double from, double to) {
    low = std::min(low, from);
    high = std::max(high, to);
  }
  double at(double fraction) const { return low * std::pow(high / low, fraction); }  ///< on a logarithmic axis
  Range widened(double factor) const { return {low / factor, high * factor}; }
};

/// Range and tics of a logarithmic axis, 'x' or 'y': decades have labels, and 2 and 5 as well where there are few
/// decades.
std::string log_axis(char axis, const Range& range);

/// Terminal, by gnuplot's variable `type`, and borders of a chart, width by height [pixels].
std::string chart_style(int width, int height);

/// Writes a script that draws these charts, each as SVG and PNG, into charts.gp, and runs it. Returns an empty string,
/// or why there are no charts (no gnuplot).
std::string draw_with_gnuplot(OutputDirectory& out, const std::string& script, const std::vector<std::string>& charts);

}  // namespace efree::internal
