// SPDX-License-Identifier: GPL-3.0-or-later
/// A run of explicit dynamics, read back from the files of its DynamicsRecord.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Bodies at one time.
template <int Dim> struct RecordedFrame {
  Points<Dim> points, nodes;
  std::vector<Index> body_of_point;
  bool has_merged_nodes = false;                        ///< nodes without a mass, as merging leaves them
  std::vector<std::pair<std::string, Vector>> scalars;  ///< at points, in the order of the file
};

/// 2 or 3: whether the points of the run in a folder are in the plane z = 0. Throws InputError as RecordedRun does.
int recorded_dimension(const std::filesystem::path& folder);

template <int Dim> class RecordedRun {
 public:
  /// Throws InputError if the folder has no run of explicit dynamics, or files that are none of it.
  explicit RecordedRun(std::filesystem::path folder);

  Index num_frames() const { return static_cast<Index>(frames_.size()); }
  double time(Index frame) const { return frames_[frame].first; }
  /// Reads one of these frames. Throws InputError for a file that is missing or damaged, and for values that are not
  /// finite.
  RecordedFrame<Dim> frame(Index frame) const;
  /// The bodies at the start, if the run has left them; regions are bodies.
  const std::optional<FineMesh<Dim>>& bodies() const { return bodies_; }
  /// As in the case file.
  const std::string& title() const { return title_; }

 private:
  std::filesystem::path folder_;
  std::vector<std::pair<double, std::string>> frames_;  // times and files of points
  std::optional<FineMesh<Dim>> bodies_;
  std::string title_;
};

}  // namespace efree
