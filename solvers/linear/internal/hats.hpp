// SPDX-License-Identifier: GPL-3.0-or-later
/// Functions of the fine mesh alone, for errors that the cloud cannot see.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/basis/shape_table.hpp"

namespace efree {

/// Functions around some nodes of a mesh that sum to one (Shepard 1968).
template <int Dim> struct Hats {
  ShapeTable<Dim> shape;  ///< at the nodes of K
  Points<Dim> nodes;      ///< Dim x shape.num_nodes()
  double apart;           ///< twice the mean distance to the nearest of them, in edges
};

/// Hats around nodes of K, which are at `places`, 2.5 edges apart along the mesh, farther in space where there would be
/// so many that their factor costs more than iterations. Edges count by their length over the longest at their ends, so
/// that slivers are no distance. Nodes without stiffness get none. The same on any number of threads.
template <int Dim> Hats<Dim> make_hats(const BlockMatrix<Dim>& K, const Points<Dim>& places);

}  // namespace efree
