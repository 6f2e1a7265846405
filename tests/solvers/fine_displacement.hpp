// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "efree/quadrature/approximation.hpp"
#include "efree/solvers/equations/equations.hpp"

namespace efree {

/// Displacement of the vertices of the fine mesh.
template <int Dim> Points<Dim> fine_displacement(const Approximation<Dim>& approximation, const State& state) {
  return interpolate(approximation.shape, Points<Dim>(state.u.reshaped(Dim, approximation.nodes.cols())));
}

}  // namespace efree
