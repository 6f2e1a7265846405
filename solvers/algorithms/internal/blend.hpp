// SPDX-License-Identifier: GPL-3.0-or-later
/// Fits at the nodes, blended by the basis. Internal to the library.
#pragma once

#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/algorithms/static_analysis.hpp"

namespace efree::internal {

/// Displacements, strains and stresses at the fine degrees of freedom x, the latter by sum phi_I(x) (f_I + 1/2 g_I . (x
/// - x_I)) with the values f_I and slopes g_I of the fits at the nodes x_I. With f_I alone MLS functions smooth, at
/// walls one-sidedly; the whole slope overshoots as much. Half of it is exact for quadratics wherever f_I and g_I are,
/// since the functions reproduce linear ones: f_I + 1/2 g_I . (x - x_I) = f + 1/2 g . (x_I - x) for values and slopes
/// f, g at x. Elements have x = x_I at every node. `fits` has a column for each node: strain and stress, then their
/// derivatives by each coordinate.
template <int Dim>
Fields<Dim> blend(const Approximation<Dim>& approximation, const Points<Dim>& coefficients, const Matrix& fits);

}  // namespace efree::internal
