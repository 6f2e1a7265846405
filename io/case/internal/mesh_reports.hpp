// SPDX-License-Identifier: GPL-3.0-or-later
/// What readers of geometries say of their meshes.
#pragma once

#include "efree/analysis/mesh_source.hpp"
#include "efree/geometry/meshing/lattice_mesh.hpp"
#include "efree/io/case/internal/section.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <string_view>

namespace efree::internal {

/// Complains of sections and keys that have no meaning for this kind of geometry.
inline void refuse(const Section& geometry, const Section::Keys& keys, std::string_view kind) {
  for (const std::string_view key : keys)
    if (geometry.has(key)) geometry.fail(key, fmt::format("{} has no meaning for {}", key, kind));
}

/// The size that was asked for, or, if none was, what is natural, which is reported.
template <int Dim> double size_or(const MeshSize& asked, double natural, MadeMesh<Dim>& made) {
  made.size = asked.length > 0.0 ? asked.length : asked.coarsening * natural;
  if (asked.length > 0.0) return made.size;
  made.reports.push_back({"mesh_size_chosen", made.size});
  made.remarks.push_back(fmt::format("mesh_size {:.4g} (none is said)", made.size));
  return made.size;
}

/// Not coarser than what is natural by more than a factor.
inline MeshSize at_most(double coarsening, MeshSize size) {
  size.coarsening = std::min(size.coarsening, coarsening);
  return size;
}
/// Meshes of images in space and surfaces lose what is thinner than their cells.
inline constexpr double may_lose_parts = 2.0;

/// Reports islands that were left out, and their part of the material.
template <class Made> void report_islands(Index islands, double fraction, Made& made) {
  made.reports.push_back({"islands_left_out", islands});
  made.reports.push_back({"islands_fraction", fraction});
  made.remarks.push_back(fmt::format("{} islands left out, {:.3g} % of the material", islands, 100.0 * fraction));
}

/// Reports what is too thin for a lattice.
void report_lost(const LostFeatures& lost, MadeMesh<3>& made);

}  // namespace efree::internal
