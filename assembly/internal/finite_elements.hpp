// SPDX-License-Identifier: GPL-3.0-or-later
/// The finite element problem of the fine mesh: what every basis on it approximates.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/assembly/materials.hpp"
#include "efree/basis/fine_space.hpp"

namespace efree {

/// Nodes of conforming elements on a fine space: the degrees of freedom on the two sides of a tie are one node.
/// Numbered along a space-filling curve (Morton 1966), so that neighbours are near in memory.
struct ElementNodes {
  std::vector<Index> at;  ///< node at each degree of freedom of the space
  Index count = 0;
};
template <int Dim> ElementNodes element_nodes(const FineSpace<Dim>& space, const std::vector<TiedFacets>& ties = {});

/// K = sum_c int_c G^T A G with the tangents A of the materials, undeformed; integrated exactly (if axisymmetric, or if
/// A varies in a region, by the cell rule of the space). `mean_dilatation`: with the mean of the dilatation in each
/// cell for the volumetric part (B-bar; Nagtegaal, Parks & Rice 1974). Quadratic cells then do not lock towards nu =
/// 1/2.
template <int Dim> BlockMatrix<Dim> element_stiffness(const FineSpace<Dim>& space, const ElementNodes& nodes,
                                                      const Materials<Dim>& materials, bool mean_dilatation = false);

}  // namespace efree
