// SPDX-License-Identifier: GPL-3.0-or-later
/// Errors by the faceted approximation of curved boundaries.
#pragma once

#include "efree/analysis/result.hpp"
#include "efree/solvers/algorithms/shape_derivative.hpp"

#include <optional>

namespace efree::internal {

/// Changes of answers on this space of the result's mesh from its facets to the true surface; none if they are the
/// same, or nothing is known of that. Refers to the space and the materials.
template <int Dim>
std::optional<ShapeDerivative<Dim>> shape_derivative(const Settings<Dim>& settings, const Result<Dim>& result,
                                                     const FineSpace<Dim>& space, const Materials<Dim>& materials);

/// Largest part of the error of facets that is left after the first-order correction (OnSurface; docs/evidence.md).
inline constexpr double left_by_first_order = 0.3;

/// The largest distance of facets from the true surface, over the thickness of the wall there, or over the radius of
/// curvature if that is less; `offsets` not empty.
template <int Dim> double largest_relative_sagitta(const FineMesh<Dim>& mesh, const Matrix& offsets);

/// Adds what facets leave to the estimates of all answers that have some (Estimates::geometry) and to the errors of
/// their largest von Mises stresses, and warns of thin walls whose facets bend.
template <int Dim> void add_facet_errors(const Settings<Dim>& settings, Result<Dim>& result);

}  // namespace efree::internal
