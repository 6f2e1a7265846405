// SPDX-License-Identifier: GPL-3.0-or-later
/// Cracks of a finished run of explicit dynamics: a mesh for each of its frames.
#pragma once

#include "efree/geometry/cracks/cracked_body.hpp"
#include "efree/io/records/recorded_run.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree {

/// All bodies of a run at the time of one frame.
template <int Dim> struct CrackFrame {
  double time = 0.0;
  CrackedMesh<Dim> mesh;
  std::vector<Index> body{};                              ///< by cell
  std::vector<std::pair<std::string, Vector>> scalars{};  ///< at nodes: fields of the points, by name
  Index edges = 0, cut_edges = 0;
  double largest_stretch = 0.0;  ///< of an edge that is not cut
};

/// Follows a run from frame to frame. Bodies whose nodes are the vertices of their mesh (OTM) are cut along this,
/// others along a mesh between their points.
template <int Dim> class CrackSeries {
 public:
  /// Keeps a reference to the run. Throws InputError as RecordedRun::frame, mesh_between and CrackedBody do.
  CrackSeries(const RecordedRun<Dim>& run, const CrackOptions& options);

  bool has_next() const { return next_ < run_.num_frames(); }
  /// The next frame. Throws InputError as RecordedRun::frame does, and if points or nodes have come or gone since the
  /// start, which cannot be followed.
  CrackFrame<Dim> next();

 private:
  /// What of a run carries the vertices of a mesh.
  struct Carriers {
    bool are_nodes = false;     ///< points of the mesh are nodes of the run, not its material points
    std::vector<Index> point;   ///< by vertex: the material point whose values it has
    std::vector<Index> body{};  ///< by vertex
    Index num_points = 0, num_nodes = 0;
  };
  static PointMesh<Dim> build_mesh(const RecordedRun<Dim>& run, Carriers& carriers);

  const RecordedRun<Dim>& run_;
  Carriers carriers_;
  CrackedBody<Dim> cracks_;
  Index next_ = 0;
};

}  // namespace efree
