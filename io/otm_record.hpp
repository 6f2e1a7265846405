// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies in motion as files.
#pragma once

#include "efree/otm/otm.hpp"

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace efree {

/// What a run of bodies in motion leaves in a folder: points_NNNN.vtu (material points: Cauchy stress, von_mises, J,
/// the scalars of histories, body) and nodes_NNNN.vtu (velocity, mass, body) with points.pvd and nodes.pvd for
/// ParaView, and history.csv: t, steps, dt, energies, momenta, forces on walls.
template <int Dim> class OtmRecord {
 public:
  /// Makes the folder if there is none, and takes an earlier record out of it. Throws InputError if it cannot be
  /// written, as all that follows.
  explicit OtmRecord(std::filesystem::path folder);
  /// A frame of each, and a line of history.csv.
  void add(const Otm<Dim>& otm);
  /// A line of history.csv alone.
  void note(const Otm<Dim>& otm);

 private:
  std::filesystem::path folder_;
  using Frames = std::vector<std::pair<double, std::string>>;  ///< times and files
  Frames points_, nodes_;
  std::string history_;
};

}  // namespace efree
