// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/gnuplot.hpp"

#include "efree/core/internal/printable.hpp"
#include "efree/io/files/child_process.hpp"
#include "efree/io/files/internal/cannot_write.hpp"

#include <fmt/format.h>
#include <fstream>

namespace efree::internal {

std::string quoted(const std::string& text) {
  std::string result;
  for (char c : printable(text)) {
    if (c == '`') c = '\'';
    if (c == '"' || c == '\\') result += '\\';
    if (c == '_' || c == '^' || c == '{' || c == '}' || c == '@' || c == '&' || c == '~') result += "\\\\";
    result += c;
  }
  return '"' + result + '"';
}

std::string log_axis(char axis, const Range& range) {
  const bool few_decades = range.high < 30.0 * range.low;
  std::string tics;
  for (int decade = static_cast<int>(std::floor(std::log10(range.low))); std::pow(10.0, decade) < range.high; ++decade)
    for (int digit = 1; digit < 10; ++digit) {
      const double value = digit * std::pow(10.0, decade);
      if (value < range.low || value > range.high) continue;
      const bool labelled = digit == 1 || (few_decades && (digit == 2 || digit == 5));
      const std::string label = !labelled     ? ""
                                : few_decades ? fmt::format("{:g}", value)
                                              : fmt::format("10^{{{}}}", decade);
      tics += fmt::format("{}'{}' {:g} {}", tics.empty() ? "" : ", ", label, value, labelled ? 0 : 1);
    }
  return fmt::format("set {0}range [{1}:{2}]; set {0}tics ({3})\n", axis, range.low, range.high, tics);
}

std::string chart_style(int width, int height) {
  return fmt::format(
             "if (type eq 'png') {{ set terminal pngcairo size {0},{1} font 'DejaVu Sans,15' enhanced }} "
             "else {{ set terminal svg size {0},{1} dynamic font 'DejaVu Sans,Helvetica,sans-serif,15' enhanced "
             "background 'white' }}\n",
             width, height) +
         "set border 3 lw 1.2 lc rgb '#333333'; set tics nomirror tc rgb '#333333'; set grid lw 0.6 lc rgb '#dddddd'\n";
}

std::string draw_with_gnuplot(OutputDirectory& out, const std::string& script, const std::vector<std::string>& charts) {
  std::ofstream file(out.file("charts.gp"));
  file << script;
  file.close();
  if (!file) cannot_write(out.file("charts.gp"));
  std::string output;
  const int status = run_program(out.staging(), {"gnuplot", "charts.gp"}, &output);
  for (const std::string& chart : charts)
    for (const char* type : {".svg", ".png"}) {
      out.supersede(chart + type);
      if (status != 0) std::filesystem::remove(out.file(chart + type));
    }
  if (status == 0) return "";
  if (status == 127) return "no charts: gnuplot is not installed (charts.gp draws them later)";
  return fmt::format("no charts: gnuplot failed with status {}: {}", status, output);
}

}  // namespace efree::internal
