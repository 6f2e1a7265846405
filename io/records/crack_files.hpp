// SPDX-License-Identifier: GPL-3.0-or-later
/// Cracks as files.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/io/files/output_directory.hpp"
#include "efree/io/records/crack_series.hpp"

#include <string>
#include <vector>

namespace efree {

struct CrackFileOptions {
  CrackOptions cracks{};
  std::string colour{};  ///< field; empty: equivalent_plastic_strain, else von_mises, else the first
  bool pictures = true;
};

/// What the table says of a frame.
struct CrackRow {
  double time = 0.0;
  Index edges = 0, cut_edges = 0, parts = 0;
  double largest_part = 0.0;     ///< share of the volume, in the plane of the area
  double crack_area = 0.0;       ///< of one face at the start; in the plane a length
  double largest_stretch = 0.0;  ///< of edges that are not cut
  double seconds = 0.0;          ///< to read and mesh the frame, by the clock
};

/// Follows a run and collects in an output directory, for each frame: cracks_NNNN.vtu (cells with body and part; at
/// nodes the place at the start and all fields) with cracks.pvd for ParaView; the surface as cracks_NNNN.obj (objects
/// surface and cracks) and cracks_NNNN.glb (glTF 2.0, cracks red, the rest coloured by a field), for which in the plane
/// all of the body is taken, and lines for the cracks; a picture cracks_NNNN.png; and cracks.csv, the table. Replaces
/// files of these names. Throws InputError as CrackSeries does, if there is no such field, and if a file cannot be
/// written. Stages: mesh between points, cracks.
template <int Dim> std::vector<CrackRow> write_cracks(OutputDirectory& out, const RecordedRun<Dim>& run,
                                                      const CrackFileOptions& options, const Monitor& monitor = {});

}  // namespace efree
