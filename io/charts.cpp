// SPDX-License-Identifier: GPL-3.0-or-later
/// Charts of a convergence study, drawn by gnuplot.
#include "efree/core/error.hpp"
#include "efree/io/child_process.hpp"
#include "efree/io/convergence.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

namespace efree {
namespace {

/// How a method looks in every chart: a colour for each family (Okabe & Ito 2008, safe for the colour-blind), a point
/// and a dash for each ratio within it.
struct Look {
  const char* colour;
  int point;
  const char* dash;
};
Look look_of(const Method& method) {
  if (method.kind == BasisKind::p1) return {"#000000", 1, "1"};
  if (method.kind == BasisKind::p2) return {"#000000", 2, "'.'"};
  if (method.secondary == SecondaryKind::full) return {"#009E73", 9, "1"};
  const bool cells = method.secondary == SecondaryKind::cells;
  const int step = method.ratio < 1.5 ? 0 : method.ratio < 3.0 ? 1 : 2;
  constexpr const char* dashes[] = {"'.'", "'-'", "1"};
  constexpr int cell_points[] = {6, 10, 7}, mls_points[] = {4, 12, 5};
  return {cells ? "#0072B2" : "#D55E00", cells ? cell_points[step] : mls_points[step], dashes[step]};
}
constexpr const char* stage_colours[] = {"#999999", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7"};

/// Text for gnuplot's enhanced mode inside double quotes.
std::string quoted(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    if (c == '_' || c == '^' || c == '{' || c == '}' || c == '@' || c == '&' || c == '~') result += "\\\\";
    result += c;
  }
  return '"' + result + '"';
}

/// Error kinds that were measured, as indices into error_kinds.
std::vector<std::size_t> measured(const Study& study) {
  std::vector<std::size_t> kinds;
  for (std::size_t k = 0; k < std::size(error_kinds); ++k)
    if (!study.rows.empty() && study.rows.front().errors.*error_kinds[k].value) kinds.push_back(k);
  return kinds;
}

/// Data block $m<i>: nodes, then seconds and every measured error, each as median, low and high.
std::string data_blocks(const Study& study) {
  std::string text;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    text += fmt::format("$m{} << EOD\n", m);
    for (const StudyPoint& point : study.points(m)) {
      text += fmt::format("{} {} {} {}", point.nodes, point.seconds.median, point.seconds.low, point.seconds.high);
      for (const std::size_t k : measured(study))
        text += fmt::format(" {} {} {}", point.errors[k]->median, point.errors[k]->low, point.errors[k]->high);
      text += '\n';
    }
    text += "EOD\n";
  }
  return text;
}

/// Smallest and largest median error of a kind and number of nodes, over all methods.
struct Box {
  double x_low = std::numeric_limits<double>::infinity(), x_high = 0.0, y_low = x_low, y_high = 0.0;
};
Box box_of(const Study& study, std::size_t kind) {
  Box box;
  for (std::size_t m = 0; m < study.methods.size(); ++m)
    for (const StudyPoint& point : study.points(m)) {
      box.x_low = std::min(box.x_low, point.nodes);
      box.x_high = std::max(box.x_high, point.nodes);
      box.y_low = std::min(box.y_low, point.errors[kind]->median);
      box.y_high = std::max(box.y_high, point.errors[kind]->median);
    }
  return box;
}

/// A triangle in the lower left corner whose side falls like H^order, H = nodes^(-1/2).
std::string slope_triangle(const Box& box, int order, int first_object) {
  const double width = std::pow(box.x_high / box.x_low, 0.22), height = std::pow(width, 0.5 * order);
  const double x0 = box.x_low * std::pow(box.x_high / box.x_low, 0.03), x1 = x0 * width;
  const double y0 = box.y_low * std::pow(box.y_high / box.y_low, 0.02), y1 = y0 * height;
  std::string text;
  const auto side = [&](int i, double ax, double ay, double bx, double by) {
    text += fmt::format("set arrow {} from {},{} to {},{} nohead lw 1.2 lc rgb '#555555' front\n", first_object + i, ax,
                        ay, bx, by);
  };
  side(0, x0, y1, x1, y0);
  side(1, x0, y0, x1, y0);
  side(2, x0, y0, x0, y1);
  text += fmt::format("set label {} 'H^{{{}}}' at {},{} left offset 0.6,0.3 tc rgb '#333333' front\n", first_object,
                      order, std::sqrt(x0 * x1), std::sqrt(y0 * y1));
  return text;
}

/// One curve per method with `x` (a gnuplot expression) against the error in slot `slot` of the data blocks.
std::string curves(const Study& study, std::size_t slot, bool against_time) {
  const std::size_t y = 5 + 3 * slot;
  std::string text = "plot ";
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const Look look = look_of(study.methods[m]);
    if (m > 0) text += ", \\\n     ";
    if (against_time)
      text += fmt::format("$m{} using 2:{}:3:4:{}:{} with xyerrorbars lw 1 pt -1 lc rgb '{}' notitle, \\\n     ", m, y,
                          y + 1, y + 2, look.colour);
    text += fmt::format("$m{} using {}:{} with linespoints lw 2 ps 1.3 pt {} dt {} lc rgb '{}' title {}", m,
                        against_time ? 2 : 1, y, look.point, look.dash, look.colour, quoted(study.methods[m].label));
  }
  return text + '\n';
}

/// Panels side by side, one for each kind of error, with the key in a column of its own on the right.
std::string panels(const Study& study, const std::string& name, const std::string& x_label, bool against_time) {
  const auto kinds = measured(study);
  const double key_width = 0.23 * 3 / (kinds.size() + 0.69), left = 0.05, gap = 0.045;
  const double width =
      (1.0 - key_width - left - gap * static_cast<double>(kinds.size() - 1)) / static_cast<double>(kinds.size());
  std::string text = fmt::format("set output '{}.'.type\nset multiplot\n", name);
  for (std::size_t slot = 0; slot < kinds.size(); ++slot) {
    const ErrorKind& kind = error_kinds[kinds[slot]];
    const double x0 = left + static_cast<double>(slot) * (width + gap);
    text += fmt::format(
        "set lmargin at screen {}; set rmargin at screen {}; set tmargin at screen 0.90; set bmargin at screen 0.14\n",
        x0, x0 + width);
    text += fmt::format("set title {} offset 0,-0.3\nset xlabel {}\n", '"' + std::string(kind.label) + '"',
                        '"' + x_label + '"');
    text += slot == 0 ? "set ylabel 'relative error' offset 0.5\n" : "unset ylabel\n";
    text += slot + 1 == kinds.size()
                ? fmt::format("set key at screen {},0.89 left top Left reverse vertical spacing 1.35 samplen 2.5\n",
                              x0 + width + 0.012)
                : std::string("unset key\n");
    if (!against_time) {
      text += "unset arrow; unset label\n";
      text += slope_triangle(box_of(study, kinds[slot]), kinds[slot] == 0 ? 2 : 1, 1);
    }
    text += curves(study, slot, against_time);
  }
  return text + "unset multiplot\nunset arrow; unset label\n";
}

/// Stacked bars: seconds per stage, for each method at its finest spacing, or for each spacing of the only method.
std::string stage_bars(const Study& study) {
  struct Bar {
    std::string label;
    StudyPoint point;
  };
  std::vector<Bar> bars;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const auto points = study.points(m);
    if (study.methods.size() == 1)
      for (const StudyPoint& point : points) bars.push_back({fmt::format("H = {:.4g}", point.spacing), point});
    else
      bars.push_back({fmt::format("{}, {:.0f} nodes", study.methods[m].label, points.back().nodes), points.back()});
  }
  const auto& stages = bars.front().point.stages;
  std::string text = "$bars << EOD\n";
  for (const Bar& bar : bars) {
    text += quoted(bar.label);
    for (const auto& [stage, seconds] : bar.point.stages) text += fmt::format(" {}", seconds);
    text += '\n';
  }
  text += "EOD\n";
  // Horizontal bars, drawn as boxes: names are long.
  text += fmt::format(
      "set output 'stages.'.type\nunset logscale; unset title; unset ylabel; set format x '%g'; set grid x; unset "
      "grid\n"
      "set lmargin at screen 0.30; set rmargin at screen 0.86; set tmargin at screen 0.95; set bmargin at screen 0.14\n"
      "set key at screen 0.87,0.94 left top Left reverse vertical spacing 1.35 samplen 1.5\n"
      "set xlabel 'seconds (median over clouds)'; set xrange [0:*]; set yrange [{}:-0.6]; set ytics nomirror scale 0; "
      "set style fill solid 1 noborder\n",
      static_cast<double>(bars.size()) - 0.4);
  text += "plot ";
  for (std::size_t s = 0; s < stages.size(); ++s) {
    std::string below = "0";
    for (std::size_t i = 0; i < s; ++i) below += fmt::format("+${}", i + 2);
    text += fmt::format(
        "{}$bars using ({}):0:({}):({}+${}):($0-0.36):($0+0.36):ytic(1) with boxxyerror lc rgb '{}' title '{}'",
        s ? ", \\\n     " : "", below, below, below, s + 2, stage_colours[s], stages[s].first);
  }
  return text + '\n';
}

std::string script(const Case& analysis, const Study& study) {
  const auto kinds = measured(study);
  const int width = kinds.size() > 1 ? 520 * static_cast<int>(kinds.size()) + 420 : 1100;
  std::string text = "# Charts of a convergence study; run with: gnuplot charts.gp\n# " + analysis.title + "\n";
  text += data_blocks(study);
  text += "do for [type in 'svg png'] {\nreset\n";
  text += fmt::format(
      "if (type eq 'png') {{ set terminal pngcairo size {0},640 font 'DejaVu Sans,15' enhanced }} "
      "else {{ set terminal svg size {0},640 dynamic font 'DejaVu Sans,Helvetica,sans-serif,15' enhanced background "
      "'white' }}\n",
      width);
  text +=
      "set border 3 lw 1.2 lc rgb '#333333'; set tics nomirror tc rgb '#333333'; set grid lw 0.6 lc rgb '#dddddd'\n";
  text += "set bars 0; set pointsize 1.2\n";
  if (!kinds.empty()) {
    text += "set logscale xy; set format '10^{%L}'\n";
    text += panels(study, "convergence", "number of nodes", false);
    text += panels(study, "error_against_time", "seconds, mesh to solve", true);
  }
  text += stage_bars(study);
  return text + "set output\n}\n";
}

}  // namespace

std::string write_charts(const std::filesystem::path& folder, const Case& analysis, const Study& study) {
  std::ofstream file(folder / "charts.gp");
  file << script(analysis, study);
  if (!file.flush()) throw InputError(fmt::format("cannot write {}", (folder / "charts.gp").string()));
  file.close();
  std::string output;
  const int status = run_program(folder, {"gnuplot", "charts.gp"}, &output);
  if (status == 0) return "";
  if (status == 127) return "no charts: gnuplot is not installed (charts.gp draws them later)";
  return fmt::format("no charts: gnuplot failed with status {}: {}", status, output);
}

}  // namespace efree
