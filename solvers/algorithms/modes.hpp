// SPDX-License-Identifier: GPL-3.0-or-later
/// Directions in which a body gives way.
#pragma once

#include "efree/solvers/equations/equations.hpp"

namespace efree {

/// Of the tangent at a state, the eigenvector of the lowest of the eigenvalues nearest to zero: just beyond a point of
/// instability the mode that has become unstable. By subspace iteration with the inverse (Bathe & Wilson 1972), two
/// vectors more than there are negative eigenvalues, at most eight. As a change of the coefficients, its largest entry
/// 1; the same on any number of threads. Throws what the factorisation throws.
Vector softest_mode(const Equations& equations, const State& at);

}  // namespace efree
