// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

namespace efree::internal {

/// Points on facets of the boundary, the corners among them, no further apart than that along edges; sorted by their
/// coordinates, each place once.
template <int Dim> Points<Dim> sample_boundary(const FineMesh<Dim>& mesh, double apart);
/// Of these facets alone.
template <int Dim> Points<Dim> sample_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets, double apart);

/// Facets that are cut into smaller ones, oriented alike.
template <int Dim> struct CutFacets {
  Points<Dim> vertices;  ///< each place on shared edges once
  Facets<Dim> facets;    ///< of these
};
/// All of these facets of a mesh cut into as many parts along each edge, such that no edge is longer than `size`.
template <int Dim> CutFacets<Dim> cut_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets, double size);

}  // namespace efree::internal
