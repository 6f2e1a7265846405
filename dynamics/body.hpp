// SPDX-License-Identifier: GPL-3.0-or-later
/// Deformable bodies of explicit dynamics: nodes that carry the motion, material points that carry everything else.
#pragma once

#include "efree/basis/shape_table.hpp"
#include "efree/dynamics/fracture/criteria.hpp"
#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/materials/material.hpp"
#include "efree/materials/strength.hpp"
#include "efree/quadrature/approximation.hpp"

#include <optional>

namespace efree {

/// A body at rest in its reference configuration, of one material.
template <int Dim> struct DeformableBody {
  Points<Dim> nodes;     ///< Dim x N
  Points<Dim> velocity;  ///< Dim x N, at the start, of nodes; Dim x M of points if N = 0; empty: at rest [length/time]
  Points<Dim> points;    ///< Dim x M, material points, each between nodes
  Vector volumes;        ///< M, positive; in the plane per unit thickness, axisymmetric times 2 pi r
  /// M columns of Dim + 1 nodes: the cell around each point, positively oriented; their outer facets are the surface
  /// for contact. Empty: the body has no surface.
  Cells<Dim> cells{};
  /// M, numbered from 0: material points of one pressure patch share their mean dilatation (F-bar patches: de Souza
  /// Neto, Andrade Pires & Owen 2005). Empty: every point is a patch of its own.
  std::vector<Index> patches;
  SharedMaterial material;
  double density = 0.0;  ///< of mass, in the reference configuration
  Vector densities{};    ///< M, where points differ; empty: `density` is of all of them
  FractureCriteria fracture{};
  Strength strength{};  ///< for the utilisation in results; the run does not use it
  double radius = 0.0;  ///< walls and rigid bodies stay that far away from the nodes [length]
  /// Shape functions at the material points, with gradients: for the total Lagrangian scheme, which keeps them.
  std::optional<ShapeTable<Dim>> shape{};
  /// K x N, with `shape`: shape functions at points of the surface, which walls act on. None: walls act on the nodes.
  std::optional<ShapeTable<Dim>> surface{};
  /// Terms of the series for the inverse of the consistent mass, with `shape`. 1: lumped masses, which slow waves down
  /// where shape functions are wide. Three are taken for an even number that would be negative (total_lagrangian).
  Index mass_terms = 1;
};

/// Nodes at the vertices of a mesh, a material point in the middle of every cell, pressure patches of the points
/// nearest to the same node (too many points for the nodes lock otherwise). Axisymmetric: x is the radius, volumes are
/// those of the rings. Throws InputError for an axisymmetric mesh beyond the axis.
template <int Dim> DeformableBody<Dim> deformable_body(const FineMesh<Dim>& mesh, SharedMaterial material,
                                                       double density, bool axisymmetric = false);

/// Support of moving least squares on a cloud in explicit dynamics, over the spacing: narrower shape functions than in
/// statics carry shorter waves.
inline constexpr double dynamics_support = 1.75;

/// Nodes, shape functions and quadrature of the static solver, which stay what they are (total Lagrangian). Of a cloud:
/// four terms for the mass, walls act on the fine vertices of the boundary. Of finite elements: lumped masses, walls
/// act on the nodes. Throws InputError for quadratic finite elements, whose masses are not positive, and for
/// dilatations averaged by other than constant pressures (PressureKind::constant).
template <int Dim>
DeformableBody<Dim> deformable_body(const Approximation<Dim>& approximation, SharedMaterial material, double density);

}  // namespace efree
