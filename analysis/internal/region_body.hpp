// SPDX-License-Identifier: GPL-3.0-or-later
/// Regions of a mesh on their way to bodies of a run, and what acts on them.
#pragma once

#include "efree/analysis/dynamics.hpp"

#include <map>
#include <string>
#include <vector>

namespace efree::internal {

/// A region as a body, with its nodes on parts of the boundary.
template <int Dim> struct RegionBody {
  DeformableBody<Dim> body;
  std::map<std::string, std::vector<Index>> nodes_on{};   ///< by part with prescribed velocities, ascending
  std::map<std::string, std::vector<Index>> points_on{};  ///< likewise, where nodes do not persist
  std::map<std::string, SurfacePart<Dim>> surfaces{};     ///< by part with loads or a gas inside, of its own nodes
};

template <int Dim> bool is_axisymmetric(const DynamicsSettings<Dim>& settings) {
  return Dim == 2 && settings.common.model.plane == Plane::axisymmetric;
}

/// Walls, rigid bodies, gravity, loads, gases and prescribed velocities.
template <int Dim> void add_loads(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                  DynamicsModel<Dim>& model);

}  // namespace efree::internal
