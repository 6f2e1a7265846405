// SPDX-License-Identifier: GPL-3.0-or-later
/// Loops over points between them and the grid, whose nodes a chunk of points has as slots of a box.
#pragma once

#include "efree/core/types.hpp"

namespace efree::internal {

/// The box of grid nodes around the points of a chunk. Slot s of node (i, j, k) in the box: i stride[0] + j stride[1] +
/// k, without k in the plane.
struct GridBox {
  int dim = 3, degree = 2;
  double cell = 0.0;
  double low[3] = {};  ///< position of slot 0
  std::ptrdiff_t stride[2] = {};
};

/// Modes of the velocity around a point: products of polynomials along the axes that are orthogonal by the values of
/// the splines (Fu, Guo, Gast, Jiang & Teran 2017), up to degree 2 for splines of degree 2 and 3, to degree 1 for those
/// of degree 1.
constexpr int num_modes(int dim, int degree) {
  const int along = degree == 1 ? 2 : 3;
  return dim == 2 ? along * along : along * along * along;
}

/// Columns of four numbers that `gather` writes for a point: velocity, its spatial gradient by three columns, its
/// affine part by three columns (sum N v (x) d over the second moment; of degree 1 the gradient).
inline constexpr int gathered_columns = 7;
/// What points have for the grid, by point.
struct ScatteredPoints {
  const double* x;                 ///< positions, box.dim numbers each
  const double* mass = nullptr;    ///< none: they have stresses alone
  const double* v = nullptr;       ///< velocities, box.dim numbers each
  const double* motion = nullptr;  ///< affine parts of the velocities, by columns, box.dim^2 numbers each; or none
  const double* stress = nullptr;  ///< Kirchhoff stresses, three columns of four, sixteen numbers each; or none
  const double* volume = nullptr;  ///< with these
};

/// From velocities of the slots (four numbers each) to the points, at x (box.dim numbers each).
void gather(Index points, const GridBox& box, const double* x, const double* velocity, double* columns);
/// The velocity only, four numbers for each point.
void gather_values(Index points, const GridBox& box, const double* x, const double* velocity, double* values);
/// Coefficients of all modes, four numbers each; the first is the velocity.
void gather_modes(Index points, const GridBox& box, const double* x, const double* velocity, double* modes);

/// Adds to momentum and mass, and to force, of the slots (eight numbers each). What each point adds sums up to its
/// momentum and to no force beyond rounding.
void scatter(Index points, const GridBox& box, const ScatteredPoints& of, double* slots);
/// Likewise of momenta alone, by all modes but the first, whose coefficients are zeros, and so are the fourth numbers.
void scatter_modes(Index points, const GridBox& box, const double* x, const double* mass, const double* modes,
                   double* slots);

/// Adds values, four numbers for each point, to the second four of the slots (eight numbers each), by splines.
void scatter_values(Index points, const GridBox& box, const double* x, const double* values, double* slots);

/// Marks the slots with a spline that is not zero at one of the points.
void mark_slots(Index points, const GridBox& box, const double* x, char* marked);

}  // namespace efree::internal
