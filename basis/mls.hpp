// SPDX-License-Identifier: GPL-3.0-or-later
/// Moving-least-squares functions at the fine vertices (Lancaster & Salkauskas 1981; Belytschko, Lu, Gu 1994).
#pragma once

#include "efree/basis/fine_space.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/core/monitor.hpp"
#include "efree/geometry/cloud/node_cloud.hpp"
#include "efree/heatgeo/geodesics.hpp"

namespace efree {

struct MlsOptions {
  int order = 1;         ///< polynomials reproduced: 1 or 2
  double support = 2.0;  ///< radius in units of each node's spacing
  WeightOptions weights{};
  double largest_sum = 5.0;  ///< a row with a larger sum |phi_I| counts as badly placed
  /// Named boundary parts on which the weights of all other nodes vanish.
  std::vector<std::string> vanish_on{};
};

/// Where too few nodes, or badly placed ones, made supports grow.
struct MlsReport {
  Index grown_vertices = 0;   ///< vertices that asked for it
  Index grown_nodes = 0;      ///< nodes whose support grew
  double largest_growth = 1;  ///< factor on the radius
  double largest_sum = 1;     ///< max over vertices of sum |phi_I|, in the end
  Index own_functions = 0;    ///< degrees of freedom that no rows could be had for
};

/// Polynomials of an order: 1, x, y, ...
template <int Dim> constexpr int num_polynomials(int order) {
  return order == 1 ? Dim + 1 : (Dim + 1) * (Dim + 2) / 2;
}
/// Whether no polynomial of the order but zero vanishes at all of the points.
template <int Dim> bool determine_polynomials(const Points<Dim>& points, int order);

template <int Dim> struct Mls {
  ShapeTable<Dim> shape;         ///< fine degrees of freedom x N
  std::vector<Index> node_dofs;  ///< N, fine degree of freedom each node sits on: those of the cloud first
  Vector radii;                  ///< of the nodes of the cloud, support radius in the end [length]
  MlsReport report;
};

/// phi_I = w_I g(X)^T A^-1 g(X_I), moment matrix shifted to X and scaled. Every row reproduces polynomials of the order
/// to rounding. Stages: weights, basis. Where it could not, or only with sum |phi| beyond the bound, the supports of
/// the geodesically nearest nodes grow to 1.25 times their distance until it can. Where growing does not help (fewer
/// nodes in a body than polynomials, nodes on one plane) the vertex becomes a node itself, with its own hat: its row
/// has a single 1. Throws InputError for options out of range.
template <int Dim> Mls<Dim> moving_least_squares(const FineMesh<Dim>& mesh, const NodeCloud<Dim>& cloud,
                                                 const MlsOptions& options, const Monitor& monitor = {});

/// The same at the degrees of freedom of a fine space: space.size() rows. The distance from a node to the middle of an
/// edge follows from those to its ends as the median of a triangle does from its sides (Apollonius): exact where all
/// are straight. Throws InputError for heat_flow on a space of degree 2 (no distance).
template <int Dim> Mls<Dim> moving_least_squares(const FineSpace<Dim>& space, const NodeCloud<Dim>& cloud,
                                                 const MlsOptions& options, const Monitor& monitor = {});

}  // namespace efree
