// SPDX-License-Identifier: GPL-3.0-or-later
/// Periodicity across sides of a unit cell that have other meshes, by Nitsche's method.
#pragma once

#include "efree/assembly/operators.hpp"
#include "efree/basis/fine_space.hpp"
#include "efree/solvers/algorithms/internal/frame.hpp"

#include <functional>
#include <vector>

namespace efree::internal {

/// Traction on the plane across an axis by the gradient of the field, components x (components * Dim): column
/// c * Dim + k is of d u_c / d x_k. Of materials in a region at a place.
template <int Dim> using TractionOperator = std::function<Matrix(Index region, const Vec<Dim>& x, int axis)>;

/// What the coupling adds for fluctuations w.
struct PeriodicCoupling {
  SymmetricMatrix matrix;  ///< degree of freedom = components * (that of a scalar) + component
  Matrix forces;           ///< of the unit mean gradients, a column each
  double uncovered = 0.0;  ///< largest share of a pair of sides where one is material and the other void
};

/// On the overlap of the facets of opposite sides, with the jump [w] = w(upper) - w(lower) and the traction t(w) along
/// the axis,
///   - int {t(w)}.[v] - int {t(v)}.[w] + int [w].tau [v],    forces + int {t(E)}.[v]
/// (symmetric Nitsche on meshes that do not match: Becker, Hansbo & Stenberg 2003; weights and penalty by the stiffness
/// of both sides: Annavarapu, Hautefeuille & Dolbow 2012). Facets with nothing opposite are free.
///
/// Penalty and weights follow from the trace inequality. Q with Q_rc = n_k C_rkcl n_l gives t . Q^-1 t <= e : C : e, as
/// (t . s)^2 <= (e : C : e)(s . Q s), and of gradients of degree q on a simplex the mean square on a facet is at most
/// (q + 1)(q + Dim) / Dim of that in the cell (Warburton & Hesthaven 2003). With
/// delta = 2 (q + 1)(q + Dim) / Dim * (measure of the cell's facets on such sides) / (its volume) and
/// A = (delta Q)^-1 of each side, tau = (A_upper + A_lower)^-1 and {t} = tau (A_upper t_upper + A_lower t_lower) leave
/// at least half of the energy of every w, whatever the contrast and the anisotropy; without the 2 of delta it could be
/// nothing. Moduli that vary within a cell have to do so by less than that 2. Without conductivity on one side there is
/// no coupling.
///
/// `units`: mean gradients, (components * Dim) x number of loads.
template <int Dim> PeriodicCoupling couple_sides(const FineSpace<Dim>& space, const Frame<Dim>& frame,
                                                 const std::vector<int>& axes, int components,
                                                 const TractionOperator<Dim>& traction, const Matrix& units);

}  // namespace efree::internal
