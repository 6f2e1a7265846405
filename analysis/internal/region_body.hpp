// SPDX-License-Identifier: GPL-3.0-or-later
/// Regions of a mesh on their way to bodies of a run, and what acts on them.
#pragma once

#include "efree/analysis/dynamics.hpp"

#include <cstddef>
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

/// Memory of a material point, measured, with a checkpoint.
inline constexpr double bytes_per_point = 4e3;

/// The lattice of all bodies begins at a corner of their box.
template <class Options, int Dim> Options with_origin(Options options, const FineMesh<Dim>& mesh) {
  for (int i = 0; i < Dim; ++i) options.origin[static_cast<std::size_t>(i)] = mesh.vertices().row(i).minCoeff();
  return options;
}

/// Bodies of a mesh, and what is known of them.
template <int Dim> struct MeshBodies {
  std::vector<RegionBody<Dim>> regions{};
  std::vector<std::string> names{};
  std::vector<std::string> without_inner_nodes{};
  std::vector<double> point_sizes{}, volume_changes{};
};
/// Those of the settings. Throws InputError for materials that have no density, or do not do in explicit dynamics.
template <int Dim> MeshBodies<Dim> build_bodies(const PreparedMesh<Dim>& mesh, const DynamicsSettings<Dim>& settings,
                                                const Monitor& monitor);

/// Walls, rigid bodies, gravity, loads, gases and prescribed velocities.
template <int Dim> void add_loads(const DynamicsSettings<Dim>& settings, const std::vector<RegionBody<Dim>>& regions,
                                  DynamicsModel<Dim>& model);

}  // namespace efree::internal
