// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/convergence.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/write_json.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <fstream>
#include <nlohmann/json.hpp>

namespace efree {

void write_study_csv(const std::filesystem::path& file, const Study& study) {
  std::ofstream csv(file);
  csv << "spacing,seed,method,nodes,fine_vertices,fine_cells,quadrature_points";
  for (const ErrorKind& kind : error_kinds) csv << ',' << kind.name;
  csv << ",strain_energy";
  for (const char* stage : Study::stages) csv << ",seconds_" << stage;
  csv << ",seconds_total,cpu_seconds\n";
  for (const StudyRow& row : study.rows) {
    csv << fmt::format("{},{},{},{},{},{},{}", row.spacing, row.seed, study.methods[row.method].name, row.nodes,
                       row.fine_vertices, row.fine_cells, row.quadrature_points);
    for (const ErrorKind& kind : error_kinds)
      csv << (row.errors.*kind.value ? fmt::format(",{}", *(row.errors.*kind.value)) : ",");
    csv << fmt::format(",{}", row.strain_energy);
    for (const char* stage : Study::stages) csv << fmt::format(",{:.6f}", row.times[stage]);
    csv << fmt::format(",{:.6f},{:.6f}\n", row.seconds, row.cpu_seconds);
  }
  if (!csv.flush()) internal::cannot_write(file);
}

void write_study_json(const std::filesystem::path& file, const std::string& title, const Study& study) {
  nlohmann::ordered_json json;
  json["title"] = title;
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    nlohmann::ordered_json& method = json["methods"][study.methods[m].name];
    method["label"] = study.methods[m].label;
    for (std::size_t k = 0; k < std::size(error_kinds); ++k)
      if (const auto order = study.order(m, k)) method["orders"][error_kinds[k].name] = *order;
    for (const StudyPoint& point : study.points(m)) {
      nlohmann::ordered_json entry{
          {"spacing", point.spacing}, {"nodes", point.nodes}, {"seconds", point.seconds.median}};
      for (std::size_t k = 0; k < std::size(error_kinds); ++k)
        if (point.errors[k]) entry[error_kinds[k].name] = point.errors[k]->median;
      method["medians"].push_back(std::move(entry));
    }
  }
  json["threads"] = num_threads();
  json["version"] = version();
  internal::write_json(file, json);
}

std::string order_table(const Study& study) {
  const auto cell = [](std::optional<double> value) {
    return value ? fmt::format("{:.2f}", *value) : std::string("-");
  };
  std::string table =
      fmt::format("{:<10}{:>10}{:>10}{:>10}   observed orders in the spacing (P1, P2: in nodes^(-1/{}))\n", "method",
                  "L2", "energy", "recovered", study.dimension);
  for (std::size_t m = 0; m < study.methods.size(); ++m) {
    table += fmt::format("{:<10}", study.methods[m].name);
    for (std::size_t k = 0; k < std::size(error_kinds); ++k) table += fmt::format("{:>10}", cell(study.order(m, k)));
    table += '\n';
  }
  return table;
}

}  // namespace efree
