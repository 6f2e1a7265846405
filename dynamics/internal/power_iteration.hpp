// SPDX-License-Identifier: GPL-3.0-or-later
/// The highest frequency of nodes with lumped masses.
#pragma once

#include "efree/core/types.hpp"

#include <cmath>

namespace efree::internal {

/// The square of the highest angular frequency [1/time^2], estimated from below by so many products with the stiffness,
/// beginning with `mode` (Dim x N), which becomes the fastest mode known; 0 where nothing is stiff. multiply(mode,
/// forces): the stiffness times a mode. Nodes without mass stay at rest.
template <int Dim, class Multiply>
double power_iteration(const Vector& mass, int products, const Multiply& multiply, Points<Dim>& mode) {
  Points<Dim> forces(Dim, mode.cols());
  double squared = 0.0;
  for (int k = 0; k < products; ++k) {
    multiply(mode, forces);
    double work = 0.0, norm = 0.0;
    for (Index a = 0; a < static_cast<Index>(mode.cols()); ++a) {
      work += forces.col(a).dot(mode.col(a));
      mode.col(a) = mass[a] > 0.0 ? Vec<Dim>(forces.col(a) / mass[a]) : Vec<Dim>::Zero();
      norm += forces.col(a).dot(mode.col(a));
    }
    squared = work > 0.0 ? norm / work : 0.0;
    if (!(norm > 0.0)) break;
    mode /= std::sqrt(norm);
  }
  return squared;
}

}  // namespace efree::internal
