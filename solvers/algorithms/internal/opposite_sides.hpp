// SPDX-License-Identifier: GPL-3.0-or-later
/// Opposite sides of the frame of a unit cell: what is the same on both, and how their facets overlap.
#pragma once

#include "efree/basis/fine_space.hpp"
#include "efree/solvers/algorithms/internal/frame.hpp"

#include <array>
#include <optional>
#include <vector>

namespace efree::internal {

/// Boundary facets on the two sides of the frame across an axis, ascending.
struct OppositeSides {
  std::vector<Index> lower, upper;
};
template <int Dim> OppositeSides opposite_sides(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, int axis);

/// Pairs of degrees of freedom (upper, lower) that are one period apart, if every facet on either side has one of the
/// same vertices opposite; nothing if the sides have other meshes or outlines.
template <int Dim> std::optional<std::vector<std::array<Index, 2>>> matching_dofs(const FineSpace<Dim>& space,
                                                                                  const Frame<Dim>& frame, int axis);

/// A simplex of the overlap of two opposite facets.
template <int Dim> struct FacetOverlap {
  Index upper, lower;  ///< boundary facets
  Mat<Dim> corners;    ///< by column, on the lower side; a period higher on the upper one
  double measure;      ///< length, area
};
/// The overlap of each upper facet with each lower one, in simplices, those of two facets one after the other. Facets
/// of both sides are convex, so that their overlap is (Sutherland & Hodgman 1974).
template <int Dim>
std::vector<FacetOverlap<Dim>> facet_overlaps(const FineMesh<Dim>& mesh, const Frame<Dim>& frame, int axis);

}  // namespace efree::internal
