// SPDX-License-Identifier: GPL-3.0-or-later
/// Quadrature by a secondary basis, with projected gradients (Bishop 2022).
#pragma once

#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/geometry/cloud/node_cloud.hpp"

namespace efree {

/// Functions Phi_K that sum to one, given where integrals need them.
template <int Dim> struct SecondaryBasis {
  Points<Dim> points;           ///< Dim x M, x_K
  std::vector<Index> vertices;  ///< M, a fine vertex at or near x_K, in the same body
  std::vector<Index> region;    ///< M, region of the mesh that Phi_K lives in
  std::vector<Index>
      cluster;            ///< M, ascending: functions with the same number live on the same cells; empty if none do
  SimplexRule<Dim> rule;  ///< on every cell, exact for one gradient times Phi_K
  SparseRows in_cells;    ///< (cells * rule points) x M: Phi_K at the points of the rule, cell by cell
  SparseRows on_facets;   ///< (boundary facets * facet rule points) x M: Phi_K at the points of FineSpace::facet_rule
};

/// What physics sees of a basis: points, weights, and functions with projected gradients. All integrals are over the
/// body: axisymmetric ones have the factor 2 pi r (FineSpace::measure).
template <int Dim> struct Discretization {
  Points<Dim> points;  ///< Dim x M
  Vector weights;      ///< M, w_K = int Phi_K, positive, sum = volume
  /// M x N: N = (1/w_K) int phi_I Phi_K, dN = (1/w_K) int grad(phi_I) Phi_K, hoop = (1/w_K) int (phi_I / r) Phi_K; N as
  /// far as SecondaryBasis::rule goes, which is made for gradients
  ShapeTable<Dim> shape;
  std::vector<Index> region;   ///< M, region of the mesh that each point stands for
  std::vector<Index> cluster;  ///< see SecondaryBasis

  /// One past the last of the points that share the cells of point K, which follow each other.
  Index end_of_cluster(Index K) const {
    Index end = K + 1;
    while (!cluster.empty() && end < size() && cluster[end] == cluster[K]) ++end;
    return end;
  }
  Index size() const { return static_cast<Index>(weights.size()); }
  bool axisymmetric() const { return shape.has_hoop(); }
};

/// A discretization by projection, with what conditions on the boundary need of it.
template <int Dim> struct Quadrature : Discretization<Dim> {
  SparseRows on_facets;  ///< Phi_K on the boundary, see SecondaryBasis
};

/// The cells of a mesh in clusters, each around one fine vertex.
struct Clusters {
  std::vector<Index> of_cell;   ///< cluster of each cell
  std::vector<Index> vertices;  ///< of each cluster
};
/// Every cell in the cluster of the node of `cloud` that is geodesically nearest to its centroid: straight to the node,
/// plus the detour that the vertices of the cell have to make. Nodes that get no cell are left out. Throws
/// NumericalError if a body holds no node.
template <int Dim> Clusters nearest_clusters(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud);
/// Clusters alike in size, at walls too, where nodes of a cloud own but half of one: cells go over to the cluster next
/// to them whose centroid is nearer, one layer of cells at a time (Lloyd 1982), which takes no distances in the body.
template <int Dim> Clusters levelled(const FineMesh<Dim>& mesh, Clusters clusters);

/// Clusters of fine cells around the vertices of `cloud`: Phi_K is the indicator of the cells nearest to node K, x_K
/// their centre of mass. The Gram matrix is diagonal, so the projection is the L2 one, and w_K > 0. Throws as
/// nearest_clusters, and InputError if a cluster would span two regions (see cut_regions).
template <int Dim> SecondaryBasis<Dim> cell_clusters(const FineSpace<Dim>& space, const NodeCloud<Dim>& cloud);

/// The same with clusters taken apart where nodes lie nearly as dense as fine vertices. There are too few of these then
/// for clusters, and the projection would be too soft. Where nodes have fewer than `fewest` clusters to themselves (in
/// the mean around a cluster; `shape` has their values at the fine vertices), small clusters are replaced by their
/// cells, and those of one cell by the points of the cell rule, whose functions are linear on the boundary.
template <int Dim> SecondaryBasis<Dim> cell_clusters(const FineSpace<Dim>& space, const Clusters& clusters,
                                                     const ShapeTable<Dim>& shape, double fewest);

/// Linear functions on clusters: on each of them the Dim + 1 functions (1 + xi_i . L^-1 (x - c)) / (Dim + 1), with its
/// volume W, centroid c and covariance L L^T, and the corners xi_i of the regular simplex with |xi_i|^2 = Dim. The
/// points x_i = c + L xi_i, of weight W / (Dim + 1), integrate quadratics exactly; the functions are orthogonal, so
/// that the projection is the L2 one on discontinuous linear functions, and stresses that are linear do exact work.
/// Axisymmetric: all of it with the measure 2 pi r. Clusters are taken apart into their cells where nodes have fewer
/// than `fewest` (see above), and where that takes no more points: gradients of linear functions are constant in a
/// cell, which then has one point, its centre of mass.
template <int Dim> SecondaryBasis<Dim> linear_clusters(const FineSpace<Dim>& space, const Clusters& clusters,
                                                       const ShapeTable<Dim>& shape, double fewest);

/// Phi_K = rows of a table on the fine vertices (MLS on the quadrature cloud).
template <int Dim> SecondaryBasis<Dim> secondary_from_table(const FineSpace<Dim>& space, const ShapeTable<Dim>& table,
                                                            const NodeCloud<Dim>& cloud);

/// Every point of the cell rule is a function of its own: full integration on the fine mesh.
template <int Dim> SecondaryBasis<Dim> every_cell(const FineSpace<Dim>& space);

/// w_K = int Phi_K.
template <int Dim> Vector secondary_weights(const FineSpace<Dim>& space, const SecondaryBasis<Dim>& secondary);

/// Projects the gradients of the functions in `shape` (space.size() x N) on the secondary basis with the lumped Gram
/// matrix: sum_K w_K p(x_K) dN_I(x_K) = int p grad(phi_I) for every p the secondary basis reproduces. Throws
/// NumericalError if some w_K is not positive.
template <int Dim> Quadrature<Dim> project(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                           const SecondaryBasis<Dim>& secondary);

/// The naive alternative, kept for comparison: same points and weights, but gradients taken at the points themselves.
/// Fails the patch test.
template <int Dim> Quadrature<Dim> evaluate_at_points(const FineSpace<Dim>& space, const ShapeTable<Dim>& shape,
                                                      const SecondaryBasis<Dim>& secondary);

/// A coarser quadrature by functions given at the points of a finer one (points x functions; they sum to one at every
/// point): weights are their integrals, gradients the means under them (B-bar). Throws InputError for another number of
/// rows, and for a function without points, with an integral that is not positive, or in two regions.
template <int Dim> Quadrature<Dim> merge(const Quadrature<Dim>& fine, const SparseRows& functions);

}  // namespace efree
