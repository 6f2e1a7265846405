// SPDX-License-Identifier: GPL-3.0-or-later
/// Heat on patches of the fine mesh, as a way to distances and as a weight of its own.
#pragma once

#include "efree/heatgeo/geodesics.hpp"
#include "efree/heatgeo/internal/patch.hpp"

#include <optional>

namespace efree {

/// Solves heat and Poisson problems on patches with P1 elements, lumped masses and the natural condition on the body's
/// boundary. The mesh should be Delaunay: otherwise heat can become negative, and is taken to be zero there. Keeps
/// scratch memory: use one per thread.
template <int Dim> class PatchHeat {
 public:
  /// Keeps a reference to the mesh. `heat_time` in units of the squared mean edge length of the patch.
  PatchHeat(const FineMesh<Dim>& mesh, double heat_time);
  ~PatchHeat();

  /// Distances < radius by the heat method (Crane, Weischedel, Wardetzky 2013), one field per source, unsorted. All
  /// sources share one patch and one factorisation each of the heat and the Poisson problem, so they should be
  /// neighbours.
  std::vector<LocalField> distances(std::span<const Index> sources, std::span<const double> radii);

  /// Heat of a unit at the source after implicit Euler steps to the time `time_factor` radius^2, zero on the rim,
  /// maximum 1, unsorted.
  LocalField flow(Index source, double radius, int steps, double time_factor);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The mesh with delaunay_cells, or nothing if its cells are Delaunay already.
std::optional<FineMesh<2>> delaunay_mesh(const FineMesh<2>& mesh);

}  // namespace efree
