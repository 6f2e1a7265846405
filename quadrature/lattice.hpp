// SPDX-License-Identifier: GPL-3.0-or-later
/// A mesh cut by a regular lattice: material points on the geometry that there is.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <vector>

namespace efree {

/// What a lattice cuts a mesh into: its cells with some of the mesh, in the order of their places.
template <int Dim> struct LatticePieces {
  Points<Dim> centroids;                           ///< Dim x M
  Vector volumes;                                  ///< M; in the plane areas
  Eigen::Matrix<Index, Dim, Eigen::Dynamic> cell;  ///< Dim x M, number of the lattice cell along each axis
};

/// Cuts the cells of a mesh at all planes origin + k spacing across the axes. Volumes and centroids are those of what
/// lies in a lattice cell, so both sum up to those of the mesh to rounding. Pieces smaller than `least` of a lattice
/// cell join the largest of their neighbours across a face, if there is one. Throws InputError for a spacing that is
/// not positive and for one of more than 1e8 cells across the mesh. Cost: about 1 us for every piece of a cell.
template <int Dim> LatticePieces<Dim> cut_by_lattice(const FineMesh<Dim>& mesh, const Vec<Dim>& origin, double spacing,
                                                     double least = 0.1);

}  // namespace efree
