// SPDX-License-Identifier: GPL-3.0-or-later
/// Loops over the points of a chunk. What kernels hand over for a point are four columns of four numbers.
#pragma once

#include "efree/dynamics/scheme.hpp"

#include <cstdint>

namespace efree::internal {

/// Sums over the nodes of every point of each component of x_a (three rows of four numbers) times dN_a and N_a, and in
/// the fourth column those times N_a: the position of the point.
void interpolate_gradients(Index points, const Index* offsets, const std::uint16_t* local, const TableEntry* entries,
                           const double* x, double* columns);
/// The out-of-plane part of a deformation gradient: of a solid, plane strain, or by hoop strain.
enum class PlaneKind { none, strain, axisymmetric };
/// From those rows, of points that have a volume: F_since, and F = F_since F_table where J is positive and more than
/// `least` is left of the volume a step ago; else F stays. J is its determinant. In the place of the rows go the nine
/// numbers of F_since a step ago, the norm of Green's strain of F_since, and its determinant over that a step ago.
StrainBounds update_deformation(Index points, PlaneKind plane, double least, const double* volume,
                                const double* F_table, Mat<3>* F_since, double* F, double* J, double* columns);
/// F over the cube root of J_ratio, of points that have a volume.
void apply_patch_dilatation(Index points, const double* J_ratio, const double* volume, double* F);
/// Those below write the first three columns.
/// Kirchhoff stresses P F^T, less a pressure.
void kirchhoff_stresses(Index points, const double* P, const double* F, const double* shock, double* columns);
/// moved F_since^-1.
void spatial_gradients(Index points, const Mat<3>* moved, const Mat<3>* F_since, double* columns);
/// Sum over the points of volume tau : (1 - F_since^-1), of Kirchhoff stresses in the columns: their power in the
/// motion of the last step, over a time of one.
double work_of_last_motion(Index points, const double* volume, const Mat<3>* F_since, const double* columns);
/// A factor for each point times a tangent, nine columns of three times three numbers and a zero, times what stands
/// there.
void apply_tangent(Index points, const double* tangent, const double* factor, double* columns);
/// Stiffness of points over that at rest, by their tangents (nine columns of nine numbers) and the compliance at rest
/// (as tangents of apply_tangent): the largest eigenvalue of one by the other, nearly, by power iteration; at least
/// one. And their moduli of pressure waves, the largest along an axis, where they are positive.
void stiffness_ratios(Index points, const double* tangents, const double* F, const double* compliance, double* ratio,
                      double* modulus);
/// From Kirchhoff stresses and positions what scatter_forces takes: -volume tau F_since^-T + stabilisation moved
/// moment, and stabilisation times position.
void force_columns(Index points, const double* volume, const Mat<3>* F_since, const Mat<3>* moved, const Mat<2>* moment,
                   const double* stabilisation, double* columns);
void force_columns(Index points, const double* volume, const Mat<3>* F_since, const Mat<3>* moved, const Mat<3>* moment,
                   const double* stabilisation, double* columns);
/// force_a += columns dN_a + N_a (fourth column - stabilisation x_a) over all points; force is zero before. Forces of a
/// point sum up to nothing beyond rounding, but those along the radius of an axisymmetric section.
void scatter_forces(Index points, const Index* offsets, const std::uint16_t* local, const TableEntry* entries,
                    const double* x, const double* columns, const double* stabilisation, bool axisymmetric,
                    double* force);
/// Least changes of the shape functions of every point that multipliers on sums over points of volumes times gradients
/// ask for, such that they go on to sum up to one and to have their mean at the point, to first order; and their second
/// moments. Nodes, their multipliers and points have four numbers each, those in the plane a zero along z; in an
/// axisymmetric section multipliers have there what they have along the radius. inverse: of second moments of the
/// shape functions.
void weight_changes(Index points, const Index* offsets, const std::uint16_t* local, const TableEntry* entries,
                    const double* x, const double* at, const Mat<3>* inverse, const double* volume, bool axisymmetric,
                    const double* multipliers, double* changes, Mat<3>* moment);
/// Adds what these change of those sums, to first order.
void gradient_changes(Index points, const Index* offsets, const std::uint16_t* local, const TableEntry* entries,
                      const double* x, const double* at, const Mat<3>* inverse, const double* volume, bool axisymmetric,
                      const double* changes, const Mat<3>* moment, double* sums);

}  // namespace efree::internal
