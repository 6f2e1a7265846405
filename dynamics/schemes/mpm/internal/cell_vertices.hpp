// SPDX-License-Identifier: GPL-3.0-or-later
/// Lagrangian meshes in the material point method (Jiang, Schroeder, Selle, Teran & Stomakhin 2015, section 6):
/// vertices carry mass and motion, points in the cells bear the stress.
#pragma once

#include "efree/dynamics/state.hpp"

namespace efree::internal {

/// Vertices of the cells around the points of a chunk. Chunks that share a vertex have it each, with the mass of their
/// own cells: all of them move alike.
template <int Dim> struct CellVertices {
  std::vector<Index> number;  ///< n, of the vertices in their body; -1: of a released cell
  Cells<Dim> cells;           ///< Dim + 1 x m, by columns of X and x
  Points<Dim> X, x;           ///< Dim x n, at the start and now
  Vector mass;                ///< n, equal shares of those of the cells
  PointTable<Dim> table;      ///< linear functions of the cells; its nodes are columns of x

  CellVertices() = default;
  /// Of these cells of a body, one for each point of the chunk. Throws InputError for a cell without volume.
  CellVertices(const Chunk<Dim>& chunk, const Cells<Dim>& cells, const Points<Dim>& vertices);
  /// The vertices of some of the cells; selected: where they were. Call `complete` afterwards.
  CellVertices select(const std::vector<Index>& some, std::vector<Index>& selected) const;
  /// Whether the cell of a point is one vertex now.
  bool is_released(Index point) const { return cells(0, point) == cells(1, point); }
  /// The cell of a point that bears no stress any more becomes a new vertex in its middle, the last one: no cell ties
  /// pieces together that fly apart. Call `select` and `complete` afterwards.
  void release(Index point);
  /// Finds `mass` and `table`.
  void complete(const Matter<Dim>& matter);
  /// Dim^2 x m, spatial gradients, by columns, of values at the vertices (Dim x n) at the m points.
  Points<Dim * Dim> spatial_gradients(Chunk<Dim>& chunk, const Points<Dim>& values);
  /// Forces on the vertices, four numbers each, by Kirchhoff stresses in the columns of the chunk.
  const double* forces(const World<Dim>& world, Chunk<Dim>& chunk);

  friend auto fields(CellVertices& of) { return std::tie(of.number, of.cells, of.X, of.x); }
};

}  // namespace efree::internal
