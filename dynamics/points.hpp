// SPDX-License-Identifier: GPL-3.0-or-later
/// From positions of nodes to deformations, stresses and forces of the material points.
#pragma once

#include "efree/dynamics/scheme.hpp"

namespace efree {

/// Interpolates values at the nodes (Dim x N) to the points of a chunk: their gradients and values are in
/// chunk.columns(), a row for each component, until the next call of this thread.
template <int Dim> void interpolate(const World<Dim>& world, Chunk<Dim>& chunk, const Points<Dim>& values);
/// Likewise by any table, of values by its nodes. axisymmetric: the table has hoops, values have the radius first.
template <int Dim>
void interpolate_by_table(PointTable<Dim>& table, const Points<Dim>& values, bool axisymmetric, double* columns);
/// A gradient by these rows; out of the plane it has `out_of_plane`, or that by hoops of an axisymmetric section.
template <int Dim> Mat<3> gradient_by_rows(const World<Dim>& world, const double* rows, double out_of_plane);
/// Position and F_since of a point, right after `interpolate` of the nodes' positions by this thread.
template <int Dim> void update_position(const World<Dim>& world, Chunk<Dim>& chunk, Index p);
/// Likewise, after this thread has worked on other chunks.
template <int Dim> void update_position_again(const World<Dim>& world, Chunk<Dim>& chunk, Index p);
/// Likewise of all points of a chunk, by where the nodes are now.
template <int Dim> void update_positions(const World<Dim>& world, Chunk<Dim>& chunk) {
  interpolate(world, chunk, world.nodes.x);
  for (Index p = 0; p < chunk.size(); ++p) update_position(world, chunk, p);
}

/// Kinematics, material response and internal forces of all chunks where the nodes are now, dt after the last time;
/// nodes.force are these forces. Throws NumericalError where points are inverted or the material has no answer.
template <int Dim> void compute_internal_forces(World<Dim>& world, Scheme<Dim>& scheme, double dt);
/// The internal forces of the stresses that points have now. moved: nodes have moved since these were computed, or
/// tables have changed.
template <int Dim> void assemble_internal_forces(World<Dim>& world, Scheme<Dim>& scheme, bool moved = true);
/// Kirchhoff stresses in the columns of a chunk: points of a pressure patch share the work of its dilatation.
template <int Dim> void share_patch_pressures(Chunk<Dim>& chunk);
/// Positions and deformation gradients of the points of a chunk by a table and where its nodes are, as
/// internal::update_deformation leaves them.
template <int Dim> StrainBounds deform_by_table(const World<Dim>& world, Chunk<Dim>& chunk, PointTable<Dim>& table,
                                                const Points<Dim>& nodes, double least);
/// Starts a step of a point whose deformation gradient is multiplied by this one from the left: F_table becomes F, and
/// F_since the change. Nothing changes at eroded points. Where points do not store these (PointStorage), call
/// `deform_by_increments` before this thread works on another chunk.
template <int Dim> void take_increment(Chunk<Dim>& chunk, Index p, const Mat<Dim>& change);
/// Deformation gradients of the points of a chunk after `take_increment` of all, as internal::update_deformation leaves
/// them.
template <int Dim> StrainBounds deform_by_increments(const World<Dim>& world, Chunk<Dim>& chunk, double least);
/// Forces in a table of the stresses in a chunk's columns, and of zero-energy modes, whose gradients are `moved`.
template <int Dim> void scatter_by_table(const World<Dim>& world, Chunk<Dim>& chunk, const std::vector<Mat<3>>& moved,
                                         PointTable<Dim>& table);
/// Forces in a chunk's table of the stresses in its columns, shared in pressure patches.
template <int Dim> void scatter_stresses(const World<Dim>& world, Chunk<Dim>& chunk, const std::vector<Mat<3>>& moved);
/// Dim x N, sums of the chunks' forces at every node, or at each with a mark in `of`, in the order of the chunks.
template <int Dim> void collect_forces(const World<Dim>& world, Points<Dim>& forces, const std::vector<char>& of = {});

/// Energy of the zero-energy modes of a point's nodes: motions that its shape functions and gradients do not see; by
/// where the nodes were that time ago.
template <int Dim>
double stabilisation_energy(const World<Dim>& world, const Chunk<Dim>& chunk, Index p, double ago = 0.0);
/// The same of all points, summed by chunk.
template <int Dim> std::vector<double> stabilisation_energies(const World<Dim>& world);

/// Volume of a point over that before a step, below which the step inverts the point, or nearly so.
inline constexpr double least_volume_left = 0.3;

/// Viscous pressure of a point (ShockViscosity), and the heat it makes, by Chunk::recent_gradients now and a step ago.
template <int Dim> void update_shock_pressure(const World<Dim>& world, Chunk<Dim>& chunk, Index p, const Mat<3>& now,
                                              const Mat<3>& before, double dt);
/// Shock viscosity of the first step, in which whatever has met something is compressed: by the largest velocity of
/// approach, so that what flies alone is not damped.
template <int Dim> void estimate_first_damping(World<Dim>& world);

/// From a moment: the width of shape functions along the axis where they are narrowest.
template <int Dim> double smallest_width(const Mat<Dim>& moment);

}  // namespace efree
