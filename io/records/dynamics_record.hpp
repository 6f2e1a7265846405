// SPDX-License-Identifier: GPL-3.0-or-later
/// A run of explicit dynamics as files.
#pragma once

#include "efree/dynamics/dynamics.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace efree {

/// Writes a run into a folder: points_NNNN.vtu (material points: Cauchy stress, point_scalars, body) and nodes_NNNN.vtu
/// (velocity, mass, body) with points.pvd and nodes.pvd for ParaView, and history.csv with a line for each of many
/// times: t, steps, dt, energies and counts of the ledger, momenta, forces on walls, rigid bodies, and numbers of the
/// caller. Frames are independent of each other: numbers of nodes and points may change.
template <int Dim> class DynamicsRecord {
 public:
  using Numbers = std::vector<std::pair<std::string, double>>;  ///< by name

  /// Creates the folder if need be, and removes an earlier record from it. Throws InputError if it cannot be written,
  /// as all that follow.
  explicit DynamicsRecord(std::filesystem::path folder);
  /// Continues the record in that folder from this state; later frames and lines are removed. Throws InputError for
  /// bytes that are no state.
  DynamicsRecord(std::filesystem::path folder, std::string_view state);
  /// bodies.vtu: the bodies as meshes, at the start; regions are bodies.
  void add_bodies(const FineMesh<Dim>& mesh);
  /// A frame, and a line of history.csv.
  void add(const Dynamics<Dim>& dynamics, const Numbers& more = {});
  /// A frame alone.
  void add_frame(const Dynamics<Dim>& dynamics);
  /// A line of history.csv alone. Columns that are new get 0 in earlier lines.
  void add_line(const Dynamics<Dim>& dynamics, const Numbers& more = {});

  Index num_frames() const { return static_cast<Index>(points_.size()); }
  /// What another record needs to continue this one.
  std::string state() const;
  /// Whether a file of that name is part of a record, or a picture frame_NNNN.png or frame_NAME_NNNN.png or an
  /// animation of these beside it.
  static bool is_part(const std::string& name);

 private:
  void write_series() const;
  void write_history() const;

  std::filesystem::path folder_;
  using Frames = std::vector<std::pair<double, std::string>>;  ///< times and files
  Frames points_, nodes_;
  std::vector<std::string> columns_;  ///< of history.csv
  std::string lines_;                 ///< of history.csv, below the names of the columns
};

}  // namespace efree
