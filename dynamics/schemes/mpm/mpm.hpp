// SPDX-License-Identifier: GPL-3.0-or-later
/// The material point method (Sulsky, Chen & Schreyer 1994): points carry everything, the nodes of a regular grid carry
/// the motion of one step. The grid follows the points and has no bounds.
#pragma once

#include "efree/dynamics/scheme.hpp"
#include "efree/dynamics/surface_load.hpp"

#include <array>
#include <memory>
#include <utility>
#include <vector>

namespace efree {

/// How velocities go from the grid's nodes (v, before the step v0) back to the points. N are the splines at the point,
/// d the nodes' positions less its own.
enum class Transfer {
  pic,      ///< v_p = sum N v (Harlow 1964): noise and rotation are damped
  flip,     ///< v_p = a (v_p + sum N (v - v0)) + (1 - a) sum N v (Brackbill & Ruppel 1986): noise stays
  apic,     ///< PIC with an affine velocity C = sum N v (x) d / moment around each point (Jiang et al. 2015)
  rpic,     ///< PIC with the rotation in C alone (Jiang et al. 2015)
  aflip,    ///< FLIP for v_p and APIC for C (Fei et al. 2021)
  polypic,  ///< PIC with all polynomials that the nodes around a point can tell apart (Fu et al. 2017)
  xpic,     ///< v_p = (I - (I - S S+)^m) v_p + sum N (v - v0), S from nodes to points (Hammerquist & Nairn 2017)
};

struct MpmOptions {
  double cell = 0.0;               ///< edge of the grid's cells [length]
  std::array<double, 3> origin{};  ///< position of one of its nodes
  int degree = 2;                  ///< of the B-splines, 1 to 3
  Transfer transfer = Transfer::aflip;
  double flip = 0.99;  ///< a of Transfer::flip and Transfer::aflip, 0 to 1
  int order = 2;       ///< m of Transfer::xpic, 1 to 16
  /// Strains by velocities that went to the points and back to the grid (MUSL: Sulsky, Zhou & Schreyer 1995; not for
  /// polypic), which damps nodes with little mass.
  bool remap = false;
  /// Pairs of bodies that are tied: they, and those that are tied to the same ones, share the nodes of the grid, as one
  /// body does.
  std::vector<std::pair<Index, Index>> ties{};
};

/// The scheme with a new grid in every step (updated Lagrangian). Bodies have points and no nodes, and
/// DeformableBody::velocity is that of the points; or they are meshes with vertices as nodes and a point in each cell,
/// whose strains are those between the vertices (Lagrangian MPM: Jiang et al. 2015). Bodies have grid nodes of their
/// own, which act on each other by contact where their points meet. Throws InputError for options out of range.
template <int Dim> std::unique_ptr<Scheme<Dim>> mpm(const MpmOptions& options);

/// Points of a body for mpm(): its mesh cut by a lattice of so many points along the edges of the grid's cells. Points
/// of a cell are a pressure patch. Throws InputError as cut_by_lattice does, and where the body fills less than half of
/// every cell (MpmOptions::cell is more than its thickness).
template <int Dim> DeformableBody<Dim> points_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                         Index points_along, SharedMaterial material, double density);
/// The same points with their splines in the reference configuration, which stay (total Lagrangian: de Vaucorbeil,
/// Nguyen & Hutchinson 2020), for total_lagrangian(). Nodes keep their velocities, so nothing is transferred; walls act
/// on points of the surface, which are half a cell apart and less.
template <int Dim> DeformableBody<Dim> splines_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                          Index points_along, SharedMaterial material, double density);

/// A mesh for mpm(): vertices that the grid moves, with what its cells resist. It holds together however far it is
/// stretched. Cells with their middle in the same cell of the grid are a pressure patch. Throws InputError as
/// points_on_lattice does.
template <int Dim> DeformableBody<Dim> mesh_on_lattice(const FineMesh<Dim>& mesh, const MpmOptions& options,
                                                       SharedMaterial material, double density);

/// What material points and their shape functions belong to.
enum class MpmFrame {
  updated,  ///< a new grid in every step: points_on_lattice
  total,    ///< the reference configuration: splines_on_lattice
  mesh,     ///< cells of a mesh, whose vertices a new grid in every step moves: mesh_on_lattice
};
/// A body of that frame. points_along counts but for meshes.
template <int Dim> DeformableBody<Dim> body_on_lattice(const FineMesh<Dim>& mesh, MpmFrame frame,
                                                       const MpmOptions& options, Index points_along,
                                                       SharedMaterial material, double density);

/// A part of the surface of such a body for surface_load: these facets of its mesh, but for meshes cut to half a cell
/// of the grid. In a frame with a new grid in every step `bodies` are zeros, of the run's first body.
template <int Dim> SurfacePart<Dim> surface_on_lattice(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                       MpmFrame frame, const MpmOptions& options,
                                                       const DeformableBody<Dim>& body);

/// Points, of a body, that are no further than that from these facets of its mesh, ascending: what moves with a part of
/// the boundary whose velocity is prescribed.
template <int Dim> std::vector<Index> points_near_facets(const FineMesh<Dim>& mesh, const std::vector<Index>& facets,
                                                         const Points<Dim>& points, double depth);
/// Nodes, of a body with shape functions, that have half of their mass and more from these points, ascending.
template <int Dim>
std::vector<Index> nodes_of_points(const DeformableBody<Dim>& body, const std::vector<Index>& points);

}  // namespace efree
