// SPDX-License-Identifier: GPL-3.0-or-later
/// Cases through time for tests: a strip that is pulled, and what its steps were.
#pragma once

#include "efree/tests/io/workspace.hpp"

#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace efree::test {

/// A strip of rubber between sliding planes that is pulled.
inline const std::string pulled_strip = R"([geometry]
file = "strip.geo"
mesh_size = 0.2
[cloud]
spacing = 0.4
[analysis]
plane = "strain"
[material]
model = "neo_hookean"
mu = 0.7
lambda = 1.3
[time]
step = 0.25
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
displacement = ["1.6*t", "free"]
[[probe]]
name = "end"
at = [2, 1]
)";

/// The same strip, pressed until it is turned inside out.
inline const std::string turned_strip =
    replaced(replaced(pulled_strip, "model = \"neo_hookean\"\nmu = 0.7\nlambda = 1.3",
                      "model = \"st_venant_kirchhoff\"\nE = 1\nnu = 0"),
             "1.6*t", "-2.4*t");

/// Columns of history.csv.
inline std::map<std::string, std::vector<double>> history(const std::filesystem::path& file) {
  std::istringstream lines(content(file));
  std::string line, cell;
  std::vector<std::string> names;
  std::map<std::string, std::vector<double>> columns;
  std::getline(lines, line);
  for (std::istringstream cells(line); std::getline(cells, cell, ',');) names.push_back(cell);
  while (std::getline(lines, line)) {
    std::size_t k = 0;
    for (std::istringstream cells(line); std::getline(cells, cell, ',');)
      columns[names.at(k++)].push_back(std::stod(cell));
  }
  return columns;
}

}  // namespace efree::test
