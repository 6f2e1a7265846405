// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/comparison.hpp"

#include "efree/core/internal/printable.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/write_json.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <fstream>
#include <map>
#include <string>
#include <vector>

namespace efree {
namespace {

using internal::printable;

/// A text as a field of a CSV file.
std::string csv_text(std::string text) {
  for (std::size_t i = 0; (i = text.find('"', i)) != std::string::npos; i += 2) text.insert(i, 1, '"');
  return '"' + text + '"';
}

}  // namespace

void write_comparison_csv(const std::filesystem::path& file, const Comparison& comparison) {
  std::ofstream csv(file);
  csv << "method,spacing,nodes,points,steps,time,cpu_seconds,energy_error";
  for (const ProbeReference& probe : comparison.probes)
    csv << ',' << csv_text(probe.name) << ',' << csv_text("error of " + probe.name);
  csv << ",failure\n";
  for (const ComparisonRow& row : comparison.rows) {
    csv << fmt::format("{},{},", comparison.methods[row.method].name, row.spacing);
    csv << (row.has_numbers ? fmt::format("{},{},{},{},{:.3f},{}", row.nodes, row.points, row.steps, row.time,
                                          row.cpu_seconds, row.energy_error)
                            : fmt::format(",,,,{:.3f},", row.cpu_seconds));
    for (std::size_t k = 0; k < comparison.probes.size(); ++k) {
      const auto error = comparison.error(row, k);
      csv << (row.has_numbers && !row.probes[k].empty() ? fmt::format(",{}", fmt::join(row.probes[k], " ")) : ",")
          << (error ? fmt::format(",{}", *error) : ",");
    }
    csv << ',' << csv_text(row.failure) << '\n';
  }
  if (!csv.flush()) internal::cannot_write(file);
}

void write_comparison_json(const std::filesystem::path& file, const std::string& title, const Comparison& comparison) {
  nlohmann::ordered_json json;
  json["title"] = title;
  for (const ProbeReference& probe : comparison.probes)
    json["references"][probe.name] = {
        {"value", probe.value}, {"given", probe.given}, {"runs", probe.runs}, {"uncertainty", probe.uncertainty}};
  for (const ComparisonRow& row : comparison.rows) {
    nlohmann::ordered_json entry{
        {"method", comparison.methods[row.method].name}, {"spacing", row.spacing}, {"cpu_seconds", row.cpu_seconds}};
    if (!row.failure.empty()) entry["failure"] = row.failure;
    if (row.has_numbers) {
      entry.update({{"nodes", row.nodes},
                    {"points", row.points},
                    {"steps", row.steps},
                    {"time", row.time},
                    {"energy_error", row.energy_error},
                    {"warnings", row.warnings}});
      for (std::size_t k = 0; k < comparison.probes.size(); ++k) {
        if (!row.probes[k].empty()) entry["probes"][comparison.probes[k].name]["value"] = row.probes[k];
        if (const auto error = comparison.error(row, k)) entry["probes"][comparison.probes[k].name]["error"] = *error;
      }
    }
    json["runs"].push_back(std::move(entry));
  }
  json["threads"] = num_threads();
  json["version"] = version();
  internal::write_json(file, json);
}

std::string comparison_table(const Comparison& comparison) {
  // Columns are as wide as they are printed, whatever the characters; names cannot tell the terminal what to do.
  std::vector<std::string> names;
  for (const ProbeReference& probe : comparison.probes) names.push_back(fmt::format("{:>10}", printable(probe.name)));
  const auto width = [](const std::string& text) {
    return static_cast<std::size_t>(
        std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
  };
  std::string table = fmt::format("{:<17}{:>10}{:>9}{:>9}{:>8}{:>10}{:>10}", "method", "spacing", "nodes", "points",
                                  "steps", "CPU [s]", "energy");
  for (const std::string& name : names) table += "  " + name;
  table += "\n";
  for (const ComparisonRow& row : comparison.rows) {
    table += fmt::format("{:<17}{:>10.4g}", comparison.methods[row.method].name, row.spacing);
    table += row.has_numbers ? fmt::format("{:>9}{:>9}{:>8}{:>10.2f}{:>10.1e}", row.nodes, row.points, row.steps,
                                           row.cpu_seconds, row.energy_error)
                             : fmt::format("{:>9}{:>9}{:>8}{:>10.2f}{:>10}", "-", "-", "-", row.cpu_seconds, "-");
    for (std::size_t k = 0; k < comparison.probes.size(); ++k) {
      const auto error = comparison.error(row, k);
      const std::string cell = error ? fmt::format("{:.1e}", *error) : "-";
      table += std::string(2 + width(names[k]) - cell.size(), ' ') + cell;
    }
    table += row.failure.empty() ? "\n" : "  failed\n";
  }
  table += "energy: largest error of its balance; probes: relative errors\n";
  for (const ProbeReference& probe : comparison.probes) {
    table += printable(probe.name) + ": ";
    if (probe.value.empty())
      table += "no run has a value\n";
    else if (probe.given)
      table += fmt::format("the case gives {:.6g}\n", fmt::join(probe.value, ", "));
    else if (probe.runs == 1)
      table += fmt::format("{:.6g} in the finest run, which no other method confirms\n", fmt::join(probe.value, ", "));
    else
      table += fmt::format("{:.6g}, the median of the finest runs, which are up to {:.1e} away from it\n",
                           fmt::join(probe.value, ", "), probe.uncertainty);
  }
  // A failure or warning that several runs of a method share is one line.
  std::map<std::pair<std::size_t, std::string>, std::vector<double>> said;
  for (const ComparisonRow& row : comparison.rows) {
    if (!row.failure.empty()) said[{row.method, "failed: " + row.failure}].push_back(row.spacing);
    for (const std::string& warning : row.warnings) said[{row.method, "warning: " + warning}].push_back(row.spacing);
  }
  for (const auto& [what, spacings] : said)
    table += fmt::format("{}, nodes {:.4g} apart: {}\n", comparison.methods[what.first].name, fmt::join(spacings, ", "),
                         printable(what.second));
  return table;
}

}  // namespace efree
