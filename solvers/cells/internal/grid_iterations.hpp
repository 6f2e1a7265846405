// SPDX-License-Identifier: GPL-3.0-or-later
/// Conjugate gradients on a grid of cells.
#pragma once

#include "efree/core/monitor.hpp"
#include "efree/solvers/cells/internal/multigrid.hpp"

namespace efree::internal {

/// An energy of a field u under forces f, twice: given + of_work f . u + of_own u . K u, but not less than `least`.
struct ReferenceEnergy {
  double given = 0.0, of_work = 0.0, of_own = 1.0, least = 0.0;

  double of(double work, double own) const { return std::max(least, given + of_work * work + of_own * own); }
};

/// When iterations end.
struct IterationLimits {
  double tolerance;  ///< of the error in the energy norm, relative to the reference energy
  int most;
};

struct Iterated {
  int iterations = 0;
  double error = 0.0;  ///< that is left, in the energy norm, relative
};

/// Energy of a field that is none but for rounding, twice.
double rounding_energy(const GridLevel& grid, const Field& u);

/// Solves K u = f on grid l from u on, which is complete and has the prescribed displacements, in single precision;
/// what iterations add up to is in double precision. f: empty if there are no forces. Scaled units. Throws
/// NumericalError if the iterations break down or do not end.
Iterated iterate(const GridLevel& grid, std::size_t l, const Field& forces, Multigrid& precondition,
                 const ReferenceEnergy& reference, const IterationLimits& limits, const Stage& stage, Field& u);

}  // namespace efree::internal
