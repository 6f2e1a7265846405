// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/comparison_charts.hpp"

#include "efree/io/pictures/internal/gnuplot.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <functional>

namespace efree {
namespace {

using internal::log_axis, internal::quoted, internal::Range;

/// A number of a run; empty: it has none.
using Measure = std::function<std::optional<double>(const ComparisonRow&)>;

/// One chart beside others: what is drawn against CPU time.
struct Panel {
  std::string title;
  Measure measure;
  double uncertainty = 0.0;  ///< below which differences mean nothing
};

/// What is drawn of an error: those that are next to nothing, or less than methods differ, are no better.
double drawn(double error, const Panel& panel) {
  return std::max({error, 0.3 * panel.uncertainty, 1e-12});
}

/// Colours that the colour-blind tell apart (Okabe & Ito 2008, and grey), one for each of compared_methods(), and
/// symbols: after the first five open ones.
constexpr const char* colours[] = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
                                   "#56B4E9", "#000000", "#8A7F00", "#777777"};
constexpr int symbols[] = {7, 5, 9, 11, 13, 6, 4, 8, 10};

/// In the key: what failed, too.
std::string label_of(const Comparison& comparison, std::size_t method) {
  const auto count = [&](bool failed) {
    return std::ranges::count_if(comparison.rows, [&](const ComparisonRow& row) {
      return row.method == method && (!failed || !row.failure.empty());
    });
  };
  const std::string& label = comparison.methods[method].label;
  const auto runs = count(false), failures = count(true);
  if (failures == runs) return label + ": failed";
  return failures == 0 ? label : fmt::format("{}: {} of {} failed", label, failures, runs);
}
bool has_data(const Comparison& comparison, const Panel& panel, std::size_t method) {
  return std::ranges::any_of(comparison.rows, [&](const ComparisonRow& row) {
    return row.method == method && panel.measure(row).has_value();
  });
}

std::string data_blocks(const Comparison& comparison, const std::vector<Panel>& panels) {
  std::string text;
  for (std::size_t p = 0; p < panels.size(); ++p)
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      text += fmt::format("$p{}m{} << EOD\n", p, m);
      for (const ComparisonRow& row : comparison.rows)
        if (const auto value = panels[p].measure(row); row.method == m && value)
          text += fmt::format("{} {}\n", row.cpu_seconds, drawn(*value, panels[p]));
      text += "EOD\n";
    }
  return text;
}

Range range_of(const Comparison& comparison, const Panel& panel, bool of_time) {
  Range range;
  for (const ComparisonRow& row : comparison.rows)
    if (const auto value = panel.measure(row)) {
      const double at = of_time ? row.cpu_seconds : drawn(*value, panel);
      range.cover(at, at);
    }
  if (!of_time && panel.uncertainty > 0.0) range.cover(panel.uncertainty, panel.uncertainty);
  return range.widened(of_time ? 1.4 : 1.8);
}

/// Panels side by side, the key in a column of its own on the right.
std::string chart(const Comparison& comparison, const std::vector<Panel>& panels, const std::string& name,
                  const std::string& y_label, std::size_t first_block) {
  constexpr double key = 520.0, left = 110.0, gap = 90.0, panel_width = 430.0;
  const double total = key + static_cast<double>(panels.size()) * (panel_width + gap) + left - gap;
  std::string text = "reset\n" + internal::chart_style(static_cast<int>(total), 560);
  text += fmt::format("set output '{}.'.type\nset logscale xy\nset multiplot\n", name);
  for (std::size_t p = 0; p < panels.size(); ++p) {
    const Panel& panel = panels[p];
    const double x0 = left + static_cast<double>(p) * (panel_width + gap);
    const Range x = range_of(comparison, panel, true), y = range_of(comparison, panel, false);
    text += fmt::format(
        "set lmargin at screen {:.4f}; set rmargin at screen {:.4f}; set tmargin at screen 0.90; set bmargin at screen "
        "0.15\n",
        x0 / total, (x0 + panel_width) / total);
    text += fmt::format("set title {}\nset xlabel 'CPU seconds'\n", quoted(panel.title));
    text += p == 0 ? fmt::format("set ylabel '{}'\n", y_label) : "unset ylabel\n";
    text += log_axis('x', x) + log_axis('y', y);
    text += p + 1 == panels.size()
                ? fmt::format("set key at screen {:.4f},0.89 left top Left reverse vertical spacing 1.4 samplen 2.5\n",
                              (x0 + panel_width + 20.0) / total)
                : std::string("unset key\n");
    text += "unset label; unset object\n";
    // Where methods disagree among themselves an error says nothing.
    if (panel.uncertainty > 0.0)
      text += fmt::format(
          "set label 1 'finest runs differ' at screen {:.4f},0.18 left front font ',11' tc rgb '#777777'\n"
          "set object 1 rectangle from {},{} to {},{} fc rgb '#eeeeee' fillstyle solid noborder behind\n",
          (x0 + 8.0) / total, x.low, y.low, x.high, panel.uncertainty);
    text += "plot ";
    for (std::size_t m = 0; m < comparison.methods.size(); ++m)
      text += fmt::format("{}{} with linespoints lw 2 ps 1.4 pt {} lc rgb '{}' title {}", m == 0 ? "" : ", \\\n     ",
                          has_data(comparison, panel, m) ? fmt::format("$p{}m{} using 1:2", first_block + p, m) : "NaN",
                          symbols[m % std::size(symbols)], colours[m % std::size(colours)],
                          quoted(label_of(comparison, m)));
    text += "\n";
  }
  return text + "unset multiplot\n";
}

}  // namespace

std::string write_charts(OutputDirectory& out, const Comparison& comparison) {
  for (const char* old : {"probes.svg", "probes.png", "energy.svg", "energy.png", "charts.gp"}) out.supersede(old);
  if (!comparison.has_results()) return "no charts: no run came to its end";
  std::vector<Panel> panels;
  for (std::size_t k = 0; k < comparison.probes.size(); ++k)
    panels.push_back({comparison.probes[k].name,
                      [&comparison, k](const ComparisonRow& row) { return comparison.error(row, k); },
                      comparison.probes[k].uncertainty});
  std::erase_if(panels, [&](const Panel& panel) {
    return std::ranges::none_of(comparison.rows,
                                [&](const ComparisonRow& row) { return panel.measure(row).has_value(); });
  });
  const std::vector<Panel> energy{{"energy balance", [](const ComparisonRow& row) {
                                     return row.failure.empty() ? std::optional(row.energy_error) : std::nullopt;
                                   }}};
  std::vector<Panel> all = panels;
  all.insert(all.end(), energy.begin(), energy.end());
  std::string script = "# Charts of a comparison; run with: gnuplot charts.gp\n" + data_blocks(comparison, all);
  script += "do for [type in 'svg png'] {\n";
  std::vector<std::string> charts{"energy"};
  if (!panels.empty()) {
    charts.emplace_back("probes");
    script += chart(comparison, panels, "probes", "relative error", 0);
  }
  script += chart(comparison, energy, "energy", "largest error, over the energy", panels.size());
  return internal::draw_with_gnuplot(out, script + "set output\n}\n", charts);
}

}  // namespace efree
