// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/study_charts.hpp"

#include "efree/io/pictures/internal/gnuplot.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace efree {
namespace {

using internal::log_axis, internal::quoted, internal::Range;

/// How a method looks in every chart: a colour for each family (Okabe & Ito 2008, safe for the colour-blind), a point
/// and a dash for each ratio within it.
struct Look {
  const char* colour;
  int point;
  const char* dash;
};
Look look_of(const Method& method) {
  if (method.kind == BasisKind::p1) return {"#000000", 1, "1"};
  if (method.kind == BasisKind::p2) return {"#CC79A7", 2, "1"};
  if (method.secondary == SecondaryKind::full) return {"#009E73", 9, "1"};
  const int step = method.ratio == 0.0  ? 2
                   : method.ratio < 1.5 ? 0
                   : method.ratio < 3.0 ? 1
                   : method.ratio < 5.0 ? 2
                                        : 3;
  constexpr const char* dashes[] = {"'.'", "'-'", "1", "'_-'"};
  constexpr int cell_points[] = {6, 10, 7, 11}, linear_points[] = {8, 14, 9, 15}, mls_points[] = {4, 12, 5, 13};
  if (method.secondary == SecondaryKind::cells) return {"#0072B2", cell_points[step], dashes[step]};
  if (method.secondary == SecondaryKind::linear) return {"#56B4E9", linear_points[step], dashes[step]};
  return {"#D55E00", mls_points[step], dashes[step]};
}
constexpr const char* stage_colours[] = {"#999999", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7"};

/// In pixels: a panel for each kind of error and a column for the key.
int chart_width(std::size_t panels) {
  return 330 + 560 * static_cast<int>(std::max<std::size_t>(panels, 2));
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

/// A chart's axes.
enum class Against { nodes, seconds };

struct Frame {
  Range x, y;
};
Frame frame_of(const Study& study, std::size_t kind, Against against) {
  Frame frame;
  for (std::size_t m = 0; m < study.methods.size(); ++m)
    for (const StudyPoint& point : study.points(m)) {
      if (against == Against::nodes)
        frame.x.cover(point.nodes, point.nodes);
      else
        frame.x.cover(point.seconds.low, point.seconds.high);
      frame.y.cover(point.errors[kind]->low, point.errors[kind]->high);
    }
  return {frame.x.widened(1.4), frame.y.widened(1.5)};
}

/// A triangle in the lower left corner whose side falls like H^order, H = nodes^(-1/dimension).
std::string slope_triangle(const Frame& frame, int order, int dimension) {
  const double width = std::pow(frame.x.high / frame.x.low, 0.2),
               height = std::pow(width, static_cast<double>(order) / dimension);
  const double x0 = frame.x.at(0.06), y0 = frame.y.at(0.06), x1 = x0 * width, y1 = y0 * height;
  std::string text = "unset arrow; unset label\n";
  const auto side = [&](double ax, double ay, double bx, double by) {
    text += fmt::format("set arrow from {},{} to {},{} nohead lw 1.2 lc rgb '#555555' front\n", ax, ay, bx, by);
  };
  side(x0, y1, x1, y0);
  side(x0, y0, x1, y0);
  side(x0, y0, x0, y1);
  text += fmt::format("set label 'H{}' at {},{} left offset 0.6,0.3 tc rgb '#333333' front\n", order == 1 ? "" : "^2",
                      std::sqrt(x0 * x1), std::sqrt(y0 * y1));
  return text;
}

/// One curve per method against the error in slot `slot` of the data blocks.
std::string curves(const Study& study, std::size_t slot, Against against) {
  const std::size_t y = 5 + 3 * slot;
  const bool timed = against == Against::seconds;
  std::string text = "plot ";
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const Look look = look_of(study.methods[m]);
    if (m > 0) text += ", \\\n     ";
    if (timed)
      text += fmt::format("$m{} using 2:{}:3:4:{}:{} with xyerrorbars lw 1 pt -1 lc rgb '{}' notitle, \\\n     ", m, y,
                          y + 1, y + 2, look.colour);
    text += fmt::format("$m{} using {}:{} with linespoints lw 2 ps 1.3 pt {} dt {} lc rgb '{}' title {}", m,
                        timed ? 2 : 1, y, look.point, look.dash, look.colour, quoted(study.methods[m].label));
  }
  return text + '\n';
}

/// Panels side by side, one for each kind of error, with the key in a column of its own on the right.
std::string panels(const Study& study, const std::string& name, Against against) {
  const auto kinds = measured(study);
  const auto count = static_cast<double>(kinds.size());
  const double pixel = 1.0 / chart_width(kinds.size());
  const double key_width = 330.0 * pixel, left = 130.0 * pixel, gap = 75.0 * pixel;
  const double width = (1.0 - key_width - left - gap * (count - 1.0)) / count;
  std::string text = fmt::format("set output '{}.'.type\nset multiplot\n", name);
  for (std::size_t slot = 0; slot < kinds.size(); ++slot) {
    const ErrorKind& kind = error_kinds[kinds[slot]];
    const Frame frame = frame_of(study, kinds[slot], against);
    const double x0 = left + static_cast<double>(slot) * (width + gap);
    text += fmt::format(
        "set lmargin at screen {:.4f}; set rmargin at screen {:.4f}; set tmargin at screen 0.90; set bmargin at screen "
        "0.14\n",
        x0, x0 + width);
    text += fmt::format("set title '{}' offset 0,-0.3\nset xlabel '{}'\n", kind.label,
                        against == Against::nodes ? "number of nodes" : "seconds, from mesh to solve");
    text += slot == 0 ? "set ylabel 'relative error'\n" : "unset ylabel\n";
    text += log_axis('x', frame.x) + log_axis('y', frame.y);
    text += slot + 1 == kinds.size()
                ? fmt::format("set key at screen {:.4f},0.89 left top Left reverse vertical spacing 1.35 samplen 2.5\n",
                              x0 + width + 20.0 * pixel)
                : std::string("unset key\n");
    if (against == Against::nodes)
      text += slope_triangle(frame, kinds[slot] == 0 ? 2 : 1, study.dimension);
    else if (slot + 1 == kinds.size())
      text += fmt::format(
          "set label \"medians; bars from\\nsmallest to largest\" at screen {:.4f},0.19 left font ',12' tc rgb "
          "'#333333'\n",
          x0 + width + 20.0 * pixel);
    text += curves(study, slot, against);
  }
  return text + "unset multiplot\nunset arrow; unset label\n";
}

struct Bar {
  std::string label;
  StudyPoint point;
};
/// Each method at its finest spacing, or each spacing of the only method.
std::vector<Bar> bars_of(const Study& study) {
  std::vector<Bar> bars;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    const auto points = study.points(m);
    if (study.methods.size() == 1)
      for (const StudyPoint& point : points)
        bars.push_back({fmt::format("H = {:.4g}, {:.0f} nodes", point.spacing, point.nodes), point});
    else
      bars.push_back({fmt::format("{}, {:.0f} nodes", study.methods[m].label, points.back().nodes), points.back()});
  }
  return bars;
}

/// Data block $bars: label and seconds per stage.
std::string bar_block(const std::vector<Bar>& bars) {
  std::string text = "$bars << EOD\n";
  for (const Bar& bar : bars) {
    text += quoted(bar.label);
    for (const auto& [stage, seconds] : bar.point.stages) text += fmt::format(" {}", seconds);
    text += '\n';
  }
  return text + "EOD\n";
}

/// Stacked horizontal bars (names are long) of the seconds per stage.
std::string stage_bars(const std::vector<Bar>& bars) {
  const auto& stages = bars.front().point.stages;
  std::string text = fmt::format(
      "set output 'stages.'.type\nunset logscale; unset title; set xtics autofreq; unset ylabel; set format x '%g'; "
      "unset grid; set grid x "
      "lw 0.6 lc rgb '#dddddd'\n"
      "set lmargin at screen 0.27; set rmargin at screen 0.87; set tmargin at screen 0.95; set bmargin at screen 0.14\n"
      "set key at screen 0.88,0.94 left top Left reverse vertical spacing 1.35 samplen 1.5\n"
      "set xlabel 'seconds (median over clouds)'; set xrange [0:*]; set yrange [{}:-0.6]; set ytics autofreq nomirror "
      "scale 0\n"
      "set style fill solid 1 noborder\nplot ",
      static_cast<double>(bars.size()) - 0.4);
  std::string below = "0";
  for (std::size_t s = 0; s < stages.size(); ++s) {
    const std::string above = fmt::format("{}+${}", below, s + 2);
    text +=
        fmt::format("{}$bars using ({}):0:({}):({}):($0-0.36):($0+0.36):ytic(1) with boxxyerror lc rgb '{}' title '{}'",
                    s ? ", \\\n     " : "", below, below, above, stage_colours[s], stages[s].first);
    below = above;
  }
  return text + '\n';
}

std::string script(const Study& study) {
  const auto kinds = measured(study);
  std::string text = "# Charts of a convergence study; run with: gnuplot charts.gp\n";
  const auto bars = bars_of(study);
  text += data_blocks(study) + bar_block(bars);
  text += "do for [type in 'svg png'] {\nreset\n";
  text += internal::chart_style(chart_width(kinds.size()), 640);
  text += "set bars 0; set pointsize 1.2\n";
  if (!kinds.empty()) {
    text += "set logscale xy\n";
    text += panels(study, "convergence", Against::nodes);
    text += panels(study, "error_against_time", Against::seconds);
  }
  text += stage_bars(bars);
  return text + "set output\n}\n";
}

}  // namespace

std::string write_charts(OutputDirectory& out, const Study& study) {
  return internal::draw_with_gnuplot(out, script(study), {"convergence", "error_against_time", "stages"});
}

}  // namespace efree
