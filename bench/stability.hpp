// SPDX-License-Identifier: GPL-3.0-or-later
/// What the rows of the stability suite share.
#pragma once

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace efree::bench {

/// A table that goes to standard output as Markdown and, if there is a folder, to FOLDER/NAME.csv.
class Table {
 public:
  Table(const std::filesystem::path& folder, const std::string& name, const std::vector<std::string>& columns) {
    if (!folder.empty()) {
      std::filesystem::create_directories(folder);
      file_.open(folder / (name + ".csv"));
    }
    row(columns);
    for (std::size_t k = 0; k < columns.size(); ++k) std::printf("|---");
    std::printf("|\n");
  }
  void row(const std::vector<std::string>& cells) {
    for (std::size_t k = 0; k < cells.size(); ++k) {
      std::printf("| %s ", cells[k].c_str());
      const char* quote = cells[k].find(',') == std::string::npos ? "" : "\"";
      file_ << (k > 0 ? "," : "") << quote << cells[k] << quote;
    }
    std::printf("|\n");
    std::fflush(stdout);
    file_ << std::endl;
  }

 private:
  std::ofstream file_;
};

/// Rows of the suite: each prints its tables. `folder` is that of Table, `seeds` the number of clouds.
struct StudyOf {
  std::filesystem::path folder{};
  int seeds = 5;
};
void cook_truth(const StudyOf& study);
void volumetric_locking(const StudyOf& study);
void surface_instability(const StudyOf& study);
void too_few_points(const StudyOf& study);
void crack(const StudyOf& study);
void random_clouds(const StudyOf& study);
void pressure_oscillation(const StudyOf& study);

}  // namespace efree::bench
