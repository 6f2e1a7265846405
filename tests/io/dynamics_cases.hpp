// SPDX-License-Identifier: GPL-3.0-or-later
/// Cases of explicit dynamics for tests: a strip of rubber, and what is done with such texts.
#pragma once

#include "efree/core/error.hpp"
#include "efree/io/case/case_file.hpp"
#include "efree/tests/io/workspace.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>
#include <sstream>
#include <string>
#include <variant>
#include <vector>

namespace efree::test {

/// A strip of rubber that falls onto a wall and comes back.
inline const std::string rubber = R"toml(title = "strip"
[geometry]
shape = "rectangle"
parameters = { width = 2, height = 1 }
mesh_size = 0.25
[analysis]
kind = "dynamics"
plane = "strain"
[material]
model = "neo_hookean"
E = 1
nu = 0.3
density = 1
[[velocity]]
value = [0, "-0.2"]
[[wall]]
normal = [0, 2]
level = -0.1
[time]
end = 4
[output]
frames = 3
history = 20
[[probe]]
name = "height"
extent = "y"
[[probe]]
name = "corner"
at = [2, 1]
)toml";

inline std::string with(const std::string& from, const std::string& to) {
  return replaced(rubber, from, to);
}
inline std::string without(const std::string& line) {
  return replaced(rubber, line + "\n", "");
}

/// Reads, and builds the model.
inline void start(const std::string& text) {
  const Workspace workspace(text);
  const auto build = [](const auto& any) {
    if constexpr (requires { build_dynamics_model(any); })
      build_dynamics_model(any);
    else
      FAIL() << "a static case";
  };
  std::visit(build, read_case(workspace / "case.toml"));
}
inline auto refuses(const std::string& text) {
  return [text] { start(text); };
}
inline auto says(const std::string& what) {
  return ::testing::ThrowsMessage<InputError>(
      ::testing::AllOf(::testing::HasSubstr("case.toml:"), ::testing::HasSubstr(what)));
}

inline Workspace::Run run(const Workspace& workspace, const std::string& text, std::vector<std::string> more = {}) {
  workspace.write("case.toml", text);
  std::vector<std::string> arguments{"run", "case.toml", "--out", "out", "--threads", "1", "--no-picture"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return workspace.efree(arguments);
}

inline std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

/// A column of history.csv.
inline std::vector<double> column(const fs::path& file, const std::string& name) {
  std::istringstream lines(content(file));
  std::string line, cell;
  std::getline(lines, line);
  std::istringstream header(line);
  std::size_t at = 0;
  while (std::getline(header, cell, ',') && cell != name) ++at;
  EXPECT_EQ(cell, name);
  std::vector<double> values;
  while (std::getline(lines, line)) {
    std::istringstream cells(line);
    for (std::size_t k = 0; k <= at; ++k) std::getline(cells, cell, ',');
    values.push_back(std::stod(cell));
  }
  return values;
}

/// A strip that flies up between a plane that comes down and a ball with a mass below.
inline const std::string between_rigid_bodies =
    replaced(rubber, "[[wall]]\nnormal = [0, 2]\nlevel = -0.1\n", R"toml([definitions]
quick = 0.1
[[rigid_body]]
shape = "plane"
normal = [0, -1]
level = -1.05
friction = "stick"
velocity = ["0.1*quick*sin(t)", "-quick*t"]
[[rigid_body]]
shape = "ball"
centre = [1, -1.6]
radius = 1.5
mass = 1
)toml");

}  // namespace efree::test
