// SPDX-License-Identifier: GPL-3.0-or-later
/// Tractions, pressures, springs and dampers on parts of the surface of bodies.
#pragma once

#include "efree/dynamics/interaction.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace efree {

/// A part of the surface: facets between vertices that move with the nodes.
template <int Dim> struct SurfacePart {
  Facets<Dim> facets;  ///< of vertices, outwards
  /// K x N: shape functions of the nodes at the vertices, of a single one where that is a node; vertices of no facet
  /// may have none.
  SparseRows functions{};
  /// Dim x K, positions of the vertices at the start, which then have the displacement by the functions. Empty: the
  /// vertices are where the functions put them.
  Points<Dim> positions{};
  /// K x N: functions by which positions of the vertices follow the nodes, where loads act by others. Empty:
  /// `functions`.
  SparseRows places{};
  /// By vertex the body that it is of, for schemes whose nodes do not stay with the material: vertices move with the
  /// points around them (of a mesh: with the nodes), and bear loads by World::functions_at. Empty: `functions` stay.
  std::vector<Index> bodies{};
};

/// What acts on a part of the surface, by position X at the start and by time. In the plane per unit thickness. Laws
/// are called by one thread; empty ones and zeros are nothing.
template <int Dim> struct SurfaceLoad {
  SurfacePart<Dim> part;
  /// Force per area at the start; keeps its direction.
  std::function<Vec<Dim>(const Vec<Dim>& X, double time)> traction{};
  /// Against the outward normal.
  std::function<double(const Vec<Dim>& X, double time)> pressure{};
  bool follows = true;  ///< the pressure: acts on the area and along the normal as they are then; else at the start
  Vec<Dim> stiffness = Vec<Dim>::Zero();  ///< of springs to where the part was at the start, per area [force/length^3]
  Vec<Dim> damping = Vec<Dim>::Zero();    ///< of dampers against its velocity, per area [force time/length^3]
};

/// For Dynamics::add_interaction. Loads are linear between the vertices; their sums of forces and moments are exact.
/// The work of tractions and pressures is "loads" in the ledger, the energy of springs "springs", that of dampers
/// "damping". Facets of points that break bear nothing any more (without cells: whose nearest point at the start
/// breaks). Throws InputError for facets of vertices that there are not, for negative numbers and for no load at all.
template <int Dim> std::unique_ptr<Interaction<Dim>> surface_load(SurfaceLoad<Dim> load);

}  // namespace efree
