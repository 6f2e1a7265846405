// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies in motion as files.
#pragma once

#include "efree/otm/otm.hpp"

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace efree {

/// What a run of bodies in motion leaves in a folder: points_NNNN.vtu (material points: Cauchy stress, point_scalars,
/// body) and nodes_NNNN.vtu (velocity, mass, body) with points.pvd and nodes.pvd for ParaView, and history.csv: t,
/// steps, dt, energies, counts, momenta, forces on walls, what tools do, and what is added.
template <int Dim> class OtmRecord {
 public:
  /// Numbers by name, the same names in every line.
  using More = std::vector<std::pair<std::string, double>>;

  /// Makes the folder if there is none, and takes an earlier record out of it. Throws InputError if it cannot be
  /// written, as all that follows.
  explicit OtmRecord(std::filesystem::path folder);
  /// Goes on with one in that folder, from where it had this state: what came later goes. Throws InputError for bytes
  /// that are no state.
  OtmRecord(std::filesystem::path folder, std::string_view state);
  /// A frame of each, and a line of history.csv.
  void add(const Otm<Dim>& otm, const More& more = {});
  /// A frame alone.
  void add_frame(const Otm<Dim>& otm);
  /// A line of history.csv alone.
  void note(const Otm<Dim>& otm, const More& more = {});

  Index num_frames() const { return static_cast<Index>(points_.size()); }
  /// All that it has to know to go on.
  std::string state() const;
  /// Whether a file of that name is part of a record, or a picture frame_NNNN.png beside it.
  static bool is_ours(const std::string& name);

 private:
  void write_series() const;

  std::filesystem::path folder_;
  using Frames = std::vector<std::pair<double, std::string>>;  ///< times and files
  Frames points_, nodes_;
  std::string history_;
};

}  // namespace efree
