// SPDX-License-Identifier: GPL-3.0-or-later
/// The same analysis on finer and finer clouds, by one method or by all of them.
#pragma once

#include "efree/analysis/analyse.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// A way to discretise.
struct Method {
  std::string name;   ///< "cells", "mls" (with M/N, as in "cells-2", unless it is the default), "full", "p1", "p2"
  std::string label;  ///< for charts
  BasisKind kind = BasisKind::mls;
  SecondaryKind secondary = SecondaryKind::cells;
  double ratio = 0.0;
};

struct StudyOptions {
  std::vector<double> spacings;  ///< H, at least two, all different [length]
  int seeds = 1;                 ///< clouds per spacing, with the seed of the settings and those that follow
  /// Both secondary bases at M/N = 1, 2, 4, full integration, P1 and P2 finite elements; otherwise the method of the
  /// settings.
  bool compare = false;
};

/// One analysis. For finite elements spacing is the element size and seeds are repetitions.
struct StudyRow {
  std::size_t method = 0;  ///< index into Study::methods
  double spacing = 0.0;
  std::uint64_t seed = 0;
  Index nodes = 0, fine_vertices = 0, fine_cells = 0, quadrature_points = 0;
  Errors errors;
  double strain_energy = 0.0;
  StageTimes times;
  double seconds = 0.0;      ///< from mesh to solve: without recovery, errors and files
  double cpu_seconds = 0.0;  ///< the same in CPU time of all threads
};

/// A measure of error, by the name it has in the files.
struct ErrorKind {
  const char* name;
  const char* label;
  std::optional<double> Errors::*value;
};
inline constexpr ErrorKind error_kinds[] = {
    {"l2_displacement", "displacement, L_2 norm", &Errors::l2_displacement},
    {"energy_norm", "energy norm, gradients of u", &Errors::energy_norm},
    {"energy_norm_recovered", "energy norm, recovered stress", &Errors::energy_norm_recovered},
};

/// What all rows of one method and spacing say together.
struct StudyPoint {
  struct Spread {
    double low = 0.0, median = 0.0, high = 0.0;
  };
  double spacing = 0.0;
  double nodes = 0.0;  ///< median
  Spread seconds;
  std::optional<Spread> errors[std::size(error_kinds)];
  std::vector<std::pair<std::string, double>> stages;  ///< median seconds
};

struct Study {
  /// Those that count: without recovery, errors and files.
  static constexpr std::array<const char*, 7> stages{"mesh",       "cloud",    "weights", "basis",
                                                     "quadrature", "assembly", "solve"};

  int dimension = 2;
  std::vector<Method> methods{};
  std::vector<StudyRow> rows{};  ///< by method, spacing, seed

  /// Medians and spreads of a method, coarse to fine.
  std::vector<StudyPoint> points(std::size_t method) const;
  /// Observed order: least-squares slope of log(median error) against log(spacing), for finite elements against
  /// log(nodes^(-1/dimension)), as the element size asked for is only a bound; error_kind an index into error_kinds;
  /// nothing without an exact solution.
  std::optional<double> order(std::size_t method, std::size_t error_kind) const;
};

/// Runs them all. The ratio of spacing to fine mesh size is that of the source (ratio, or spacing over size);
/// without either its own mesh serves all spacings. When comparing, finite elements start at elements that
/// give about as many nodes as the cloud and go on from there to the fine mesh size of the finest cloud (P2:
/// twice that), so that they get as much time as the others. Throws as analyse, naming the run.
template <int Dim> Study run_study(const MeshSource<Dim>& source, const Settings<Dim>& settings,
                                   const StudyOptions& options, const Monitor& monitor = {});

}  // namespace efree
