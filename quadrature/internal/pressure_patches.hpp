// SPDX-License-Identifier: GPL-3.0-or-later
/// Pressure patches: sets of quadrature points whose dilatations are averaged (F-bar patches: de Souza Neto, Andrade
/// Pires & Owen 2005), and the functions that pressures are made of on them.
#pragma once

#include "efree/geometry/cloud/node_cloud.hpp"
#include "efree/quadrature/discretization.hpp"

#include <vector>

namespace efree::internal {

/// By quadrature point the patch it belongs to, numbered from 0: those of clusters around vertices that are nearest to
/// one of these seeds. Patches that hold fewer than `fewest` nodes are merged, the smallest first, with the neighbour
/// that they share most of their surface with.
template <int Dim> std::vector<Index> patches_around(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& seeds,
                                                     const SecondaryBasis<Dim>& secondary,
                                                     const Quadrature<Dim>& quadrature, double fewest);
/// The same with the points of each cluster as a patch.
template <int Dim> std::vector<Index> patches_of_clusters(const SecondaryBasis<Dim>& secondary);

/// One function on each patch: points x patches.
SparseRows constant_pressures(const std::vector<Index>& patch_of);

/// Dim + 1 functions on each patch of `fewest` nodes or more, one after the other:
/// (1 + xi_i . L^-1 (x - c)) / (Dim + 1), with centroid c and covariance L L^T of its points and the corners xi_i of
/// regular_simplex. They sum to one, are orthogonal under the weights of the points and have equal integrals. One,
/// which is constant, on smaller patches and where the points are fewer than twice as many or (nearly) in a plane.
/// Points x functions.
template <int Dim>
SparseRows linear_pressures(const Discretization<Dim>& points, const std::vector<Index>& patch_of, double fewest);

}  // namespace efree::internal
