// SPDX-License-Identifier: GPL-3.0-or-later
/// A temporary folder with a small case in it, and the program to run on it.
#pragma once

#include "efree/io/files/child_process.hpp"

#include <gtest/gtest.h>
#include <unistd.h>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

namespace efree::test {

namespace fs = std::filesystem;

/// A strip [0, 2] x [0, 1]: left, bottom, right, top.
inline const std::string strip_geo = R"(length = DefineNumber[2, Name "length"];
Point(1) = {0, 0, 0};
Point(2) = {length, 0, 0};
Point(3) = {length, 1, 0};
Point(4) = {0, 1, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1};
Physical Curve("right") = {2};
Physical Curve("top") = {3};
Physical Curve("left") = {4};
Physical Surface("strip") = {1};
)";

/// The strip under tension along x: displacement (x, -0.3 y), stress (1, 0, 0). Lines count.
inline const std::string strip_case = R"(title = "strip"
[geometry]
file = "strip.geo"
mesh_size = 0.1
[cloud]
spacing = 0.4
seed = 1
[quadrature]
basis = "cells"
[basis]
kind = "mls"
order = 1
[analysis]
plane = "stress"
[material]
E = 1.0
nu = 0.3
[[boundary]]
on = "left"
displacement = [0, "free"]
[[boundary]]
on = "bottom"
displacement = ["free", "0*x"]
[[boundary]]
on = "right"
traction = ["1", "0"]
[exact]
displacement = ["x", "-0.3*y"]
stress = [1, 0, 0]
[[probe]]
name = "end"
at = [2.0, 0.5]
)";

/// A plate with a hole under the exact tractions of the infinite one (Kirsch 1898) along its outer sides.
inline const std::string plate = R"([definitions]
r2 = "x^2 + y^2"
c2 = "(x^2 - y^2)/r2"
s2 = "2*x*y/r2"
c4 = "2*c2^2 - 1"
s4 = "2*s2*c2"
q = "1/r2"
xx = "1 - q*(1.5*c2 + c4) + 1.5*q^2*c4"
yy = "-q*(0.5*c2 - c4) - 1.5*q^2*c4"
xy = "-q*(0.5*s2 + s4) + 1.5*q^2*s4"
[geometry]
shape = "plate_with_hole"
parameters = { radius = 1, half_width = 4 }
[analysis]
plane = "stress"
[material]
E = 1
nu = 0.3
[[boundary]]
on = "left"
normal_displacement = 0
[[boundary]]
on = "bottom"
normal_displacement = 0
[[boundary]]
on = "right"
traction = ["xx", "xy"]
[[boundary]]
on = "top"
traction = ["xy", "yy"]
[exact]
stress = ["xx", "yy", "xy"]
)";

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  if (at == std::string::npos) throw std::logic_error("the test's case does not contain: " + from);
  return text.replace(at, from.size(), to);
}

inline std::string content(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

inline nlohmann::json json(const fs::path& file) {
  return nlohmann::json::parse(content(file));
}

class Workspace {
 public:
  explicit Workspace(const std::string& case_text = strip_case, const std::string& name = "work") {
    std::string pattern = (fs::temp_directory_path() / "efree-test-XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("cannot create " + pattern);
    root_ = pattern;
    folder_ = root_ / name;
    fs::create_directory(folder_);
    write("strip.geo", strip_geo);
    write("case.toml", case_text);
  }
  ~Workspace() { fs::remove_all(root_); }
  Workspace(const Workspace&) = delete;
  Workspace& operator=(const Workspace&) = delete;

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  fs::path operator/(const std::string& name) const { return folder_ / name; }

  struct Run {
    int status;
    std::string output;
  };
  /// Runs efree in the folder.
  Run efree(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), EFREE_PROGRAM);
    Run run{};
    run.status = run_program(folder_, arguments, &run.output);
    return run;
  }

 private:
  fs::path root_, folder_;
};

}  // namespace efree::test
