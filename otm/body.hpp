// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies that move: nodes that carry the motion, material points that carry everything else.
#pragma once

#include "efree/basis/shape_table.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/materials/material.hpp"
#include "efree/quadrature/approximation.hpp"

#include <array>
#include <optional>

namespace efree {

/// Equivalent plastic strain at failure of a metal, (D1 + D2 exp(D3 s)) (1 + D4 ln(rate / reference)) (1 + D5 T*) with
/// s the mean stress over von Mises' and T* the homologous temperature (Johnson & Cook 1985, eq. 9). The rate counts
/// from its reference on.
struct JohnsonCookFailure {
  std::array<double, 5> D{};
  double reference = 1.0;  ///< [1/time]
  double melting = 0.0;    ///< by how much it is warmer than the reference temperature when it melts; 0: T* = 0
};

/// When a material point breaks. Several criteria may be on; all are off to begin with. Where one is, points that are
/// turned inside out break, too.
struct OtmFracture {
  /// G_c of eigenerosion [stress length], 0: none. A point under tension breaks when the energy release rate
  /// G = C r sum(m W) / sum(m) over the points that were within the radius r of it gets there (Pandolfi & Ortiz 2012;
  /// Pandolfi, Li & Ortiz 2013), W the stored energy of those under tension. C is such that the field of a crack tip in
  /// plane strain (Irwin 1957) in the middle of the ball has its own G.
  double toughness = 0.0;
  double neighbourhood = 2.0;  ///< r over the spacing of nodes; 0: the point alone, a ball as large as it
  double stretch = 0.0;        ///< largest principal stretch that is borne, more than 1; 0: any
  /// When the plastic strain, over that at failure, has summed up to 1. For materials that remember their equivalent
  /// plastic strain.
  std::optional<JohnsonCookFailure> strain{};
  bool on() const { return toughness > 0.0 || stretch > 0.0 || strain; }
};

/// A body at rest in its reference configuration, of one material.
template <int Dim> struct OtmBody {
  Points<Dim> nodes;     ///< Dim x N
  Points<Dim> velocity;  ///< Dim x N, at the start; empty: at rest [length/time]
  Points<Dim> points;    ///< Dim x M, material points, each between nodes
  Vector volumes;        ///< M, positive; in the plane per unit thickness, axisymmetric times 2 pi r
  /// M columns of Dim + 1 nodes: the cell around each point, positively oriented; their outer facets are the surface
  /// that other bodies touch. Empty: there is none.
  Cells<Dim> cells{};
  std::vector<Index> unions;  ///< M, numbered from 0: points that share their mean dilatation; empty: each its own
  SharedMaterial material;
  double density = 0.0;  ///< of mass, in the reference configuration
  Vector densities{};    ///< M, where points differ; empty: `density` is of all of them
  OtmFracture fracture{};
  /// Functions at the points, with gradients, for good; none: local maximum entropy, renewed as points move.
  std::optional<ShapeTable<Dim>> shape{};
  /// K x N, with `shape`: functions at points of the surface, which walls act on. None: nodes are the surface.
  std::optional<ShapeTable<Dim>> surface{};
  /// Terms of the series for the inverse of the consistent mass, with `shape`. 1: masses are lumped, which slows waves
  /// down where functions are wide.
  Index mass_terms = 1;
};

/// Nodes at the vertices of a mesh, a material point in the middle of every cell, dilatation shared by the points
/// nearest to the same node (too many points for the nodes lock otherwise). Axisymmetric: x is the radius, volumes are
/// those of the rings. Throws InputError for an axisymmetric mesh beyond the axis.
template <int Dim>
OtmBody<Dim> otm_body(const FineMesh<Dim>& mesh, SharedMaterial material, double density, bool axisymmetric = false);

/// Support of moving least squares on a cloud for bodies in motion, over the spacing: narrower functions than at rest
/// carry shorter waves.
inline constexpr double otm_support = 1.75;

/// Nodes, functions and quadrature of the static solver, which stay what they are (total Lagrangian). Of a cloud: four
/// terms for the mass, walls act on the fine vertices of the boundary. Of finite elements: lumped masses, walls act on
/// the nodes. Throws InputError for quadratic finite elements, whose masses are not positive, and for dilatations
/// averaged by other than constant pressures (PressureKind::constant).
template <int Dim>
OtmBody<Dim> otm_body(const Approximation<Dim>& approximation, SharedMaterial material, double density);

}  // namespace efree
