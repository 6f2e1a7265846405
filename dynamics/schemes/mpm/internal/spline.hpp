// SPDX-License-Identifier: GPL-3.0-or-later
/// B-splines on a regular grid (Steffen, Kirby & Berzins 2008): tensor products of the functions here.
#pragma once

#include "efree/core/internal/vectors.hpp"
#include "efree/core/types.hpp"
#include "efree/dynamics/schemes/mpm/internal/transfer_kernels.hpp"

#include <array>
#include <cmath>

namespace efree::internal {

/// B-splines along an axis that are not zero at a position: of Degree + 1 nodes.
template <int Degree> struct SplineRow {
  std::ptrdiff_t first;   ///< number of the first node
  double N[Degree + 1];   ///< values
  double dN[Degree + 1];  ///< derivatives [1/cell]
  double d[Degree + 1];   ///< nodes less position [cell]
};

/// position: over the cell, from node 0 on. The values sum up to one and the derivatives to nothing, to rounding.
template <int Degree> EFREE_INLINE void evaluate_spline(double position, SplineRow<Degree>& row) {
  static_assert(Degree >= 1 && Degree <= 3);
  const double first = Degree == 2 ? std::floor(position - 0.5) : std::floor(position) - (Degree == 3 ? 1.0 : 0.0);
  const double s = position - first;  // from the first node on
  row.first = static_cast<std::ptrdiff_t>(first);
  for (int i = 0; i <= Degree; ++i) row.d[i] = i - s;
  if constexpr (Degree == 1) {
    row.N[1] = s;
    row.N[0] = 1.0 - s;
    row.dN[0] = -1.0;
    row.dN[1] = 1.0;
  } else if constexpr (Degree == 2) {
    const double below = 1.5 - s, above = s - 0.5;
    row.N[0] = 0.5 * below * below;
    row.N[2] = 0.5 * above * above;
    row.N[1] = 1.0 - (row.N[0] + row.N[2]);
    row.dN[0] = -below;
    row.dN[2] = above;
    row.dN[1] = below - above;
  } else {
    const double t = s - 1.0, r = 1.0 - t;
    row.N[0] = r * r * r / 6.0;
    row.N[3] = t * t * t / 6.0;
    row.N[2] = (1.0 + 3.0 * (t + t * t - t * t * t)) / 6.0;
    row.N[1] = 1.0 - (row.N[0] + (row.N[2] + row.N[3]));
    row.dN[0] = -0.5 * r * r;
    row.dN[3] = 0.5 * t * t;
    row.dN[2] = 0.5 + t - 1.5 * t * t;
    row.dN[1] = -(row.dN[0] + (row.dN[2] + row.dN[3]));
  }
}

/// Second moment of a spline, sum N d^2, the same everywhere [cell^2]; of degree 1 it depends on the position.
constexpr double spline_moment(int degree) {
  return degree == 2 ? 0.25 : 1.0 / 3.0;
}

/// The largest sum of dN^2 / N over the nodes at a position [1/cell^2]: with lumped masses no motion of the nodes has a
/// frequency above the speed of pressure waves times the root of the sum of this over the axes. Proof: by Cauchy and
/// Schwarz, |sum u_a dN_a|^2 <= sum N_a u_a^2 sum dN_a^2 / N_a. Of degree 1 there is no bound, as nodes with hardly any
/// mass have all of their stiffness: that in the middle of a cell.
constexpr double spline_stiffness(int degree) {
  return degree == 1 ? 4.0 : degree == 2 ? 6.0 : 3.14;
}

/// Calls visit(place, spline, its gradient) for all nodes around a position, by their numbers along the axes from the
/// first of the box on, which need not be in it; not for kernels.
template <int Dim, int Degree, class Visit>
void for_each_site_of(const GridBox& box, const double* x, const Visit& visit) {
  SplineRow<Degree> axis[Dim];
  for (int i = 0; i < Dim; ++i) evaluate_spline<Degree>((x[i] - box.low[i]) / box.cell, axis[i]);
  std::array<std::ptrdiff_t, 3> at{}, place{};
  for (at[0] = 0; at[0] <= Degree; ++at[0])
    for (at[1] = 0; at[1] <= Degree; ++at[1])
      for (at[2] = 0; at[2] <= (Dim == 3 ? Degree : 0); ++at[2]) {
        double N = 1.0;
        Vec<Dim> dN = Vec<Dim>::Constant(1.0 / box.cell);
        for (int a = 0; a < Dim; ++a) {
          const auto k = static_cast<std::size_t>(a);
          place[k] = axis[a].first + at[k];
          N *= axis[a].N[at[k]];
          for (int b = 0; b < Dim; ++b) dN[b] *= a == b ? axis[a].dN[at[k]] : axis[a].N[at[k]];
        }
        visit(place, N, dN);
      }
}
template <int Dim, class Visit> void for_each_site(const GridBox& box, const double* x, const Visit& visit) {
  if (box.degree == 1) return for_each_site_of<Dim, 1>(box, x, visit);
  if (box.degree == 2) return for_each_site_of<Dim, 2>(box, x, visit);
  for_each_site_of<Dim, 3>(box, x, visit);
}

}  // namespace efree::internal
