// SPDX-License-Identifier: GPL-3.0-or-later
/// The scenes of a talk, as case files: run, then meshed. S. Wang: Simulation and visualization of ductile fracture
/// with the material point method, University of California, Los Angeles, May 6, 2020.
#pragma once

#include "efree/io/case/case_file.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/records/crack_files.hpp"
#include "efree/io/records/dynamics_run.hpp"

#include "clock.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace efree::bench {

/// A scene of bench/scenes/slides, and what the slide says: material points, and seconds a frame of its mesh.
struct Slide {
  const char* name;
  int points;
  double mesh_seconds;
};
inline constexpr Slide slides[] = {{"torn_strip", 4000, 0.2},     {"sheared_bar", 60000, 4.0},
                                   {"twisted_bar", 60000, 5.0},   {"pulled_block", 130000, 8.0},
                                   {"pierced_sheet", 77000, 5.0}, {"torn_shell", 207000, 13.0},
                                   {"crushed_heap", 200000, 16.0}};

/// What came of it.
struct SlideRun {
  Index points = 0, steps = 0, frames = 0, parts = 0;
  double seconds = 0.0;  ///< of the run, by the clock
  double smallest_J = std::numeric_limits<double>::infinity();
  double energy_error = 0.0;   ///< largest, over the largest energy
  std::string failure{};       ///< why it ended before its time
  double crack_seconds = 0.0;  ///< of all frames, with files and pictures
  double mesh_seconds = 0.0;   ///< of the slowest frame: reading, cutting, smoothing
  double crack_area = 0.0;     ///< at the end
};

/// The case with another number of points: cells, and the lengths of softening with them, times `scale`.
inline std::string scaled_case(const std::filesystem::path& file, double scale) {
  std::ifstream in(file);
  std::ostringstream text;
  static const std::regex number(R"(^(cell|length) = ([0-9.e-]+)$)");
  for (std::string line; std::getline(in, line);) {
    std::smatch found;
    if (std::regex_match(line, found, number))
      text << found[1] << " = " << std::stod(found[2]) * scale << '\n';
    else
      text << line << '\n';
  }
  return text.str();
}

template <int Dim> SlideRun run_slide(const DynamicsCase<Dim>& scene, const std::filesystem::path& out) {
  SlideRun result;
  {
    OutputDirectory directory(out);
    const PreparedMesh<Dim> mesh = prepare(scene);
    DynamicsModel<Dim> model = build_dynamics_model<Dim>(mesh, scene);
    DynamicsRun<Dim> record(out, scene, true);
    record.add_bodies(*mesh.mesh);
    result.points = model.dynamics.num_points();
    const auto look = [&] {
      for (const auto& [name, values] : point_scalars(model.dynamics))
        if (name == "J") result.smallest_J = std::min(result.smallest_J, values.minCoeff());
      record.add_frame(model);
      std::printf("scenes     %s: time %.3g, step %d, energy off by %.2g\n", scene.common.title.c_str(),
                  model.dynamics.time(), model.dynamics.steps(), model.dynamics.energy().error());
      std::fflush(stdout);
    };
    const double start = wall_seconds();
    try {
      result.failure =
          run_dynamics<Dim>(model, scene,
                            {.history_line = [&] { record.add_history_line(model); }, .frame = look, .checkpoint = {}})
              .stop_reason;
    } catch (const NumericalError& error) {
      result.failure = error.what();
    }
    result.seconds = wall_seconds() - start;
    result.steps = model.dynamics.steps();
    result.energy_error = std::abs(model.dynamics.energy().largest_error());
    record.finish(directory);
    directory.commit();
    record.remove_unfinished();
  }
  OutputDirectory directory(out / "cracks");
  const double start = wall_seconds();
  const std::vector<CrackRow> rows = write_cracks<Dim>(directory, RecordedRun<Dim>(out), {});
  result.crack_seconds = wall_seconds() - start;
  directory.commit();
  for (const CrackRow& row : rows) result.mesh_seconds = std::max(result.mesh_seconds, row.seconds);
  result.frames = static_cast<Index>(rows.size());
  result.parts = rows.back().parts;
  result.crack_area = rows.back().crack_area;
  return result;
}

/// Into `out`, where the case is, too. full: as many points as the slide has, else a quarter.
inline SlideRun run_slide(const std::filesystem::path& scenes, const Slide& slide, bool full,
                          const std::filesystem::path& out) {
  std::filesystem::create_directories(out);
  for (const auto& entry : std::filesystem::directory_iterator(scenes))
    if (entry.path().extension() == ".geo")
      std::filesystem::copy_file(entry.path(), out / entry.path().filename(),
                                 std::filesystem::copy_options::overwrite_existing);
  const bool flat = std::string(slide.name) == "torn_strip";
  std::ofstream(out / "case.toml") << scaled_case(scenes / (std::string(slide.name) + ".toml"),
                                                  full ? 1.0 : std::pow(4.0, flat ? 1.0 / 2.0 : 1.0 / 3.0));
  SlideRun result;
  std::visit(
      [&](const auto& scene) {
        if constexpr (requires { scene.frames; }) result = run_slide(scene, out);
      },
      read_case(out / "case.toml"));
  return result;
}

}  // namespace efree::bench
