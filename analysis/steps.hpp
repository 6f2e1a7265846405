// SPDX-License-Identifier: GPL-3.0-or-later
/// What is known of an analysis through time while it goes on, and where it can be taken up again.
#pragma once

#include "efree/assembly/resultants.hpp"
#include "efree/solvers/newton.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace efree {

/// One step through time that converged.
template <int Dim> struct HistoryStep {
  double time;
  int iterations;
  double left;               ///< largest force out of balance, relative
  double stored;             ///< energy [force * length]
  double dissipated;         ///< since the beginning [force * length]
  double smallest_jacobian;  ///< least volume of a quadrature point over that at rest
  double plastic_share;      ///< of the volume, in which energy was dissipated in this step
  Index negative_pivots;     ///< directions in which the energy falls: above 0 the body is not stable
  Resultants<Dim> reactions;
  std::vector<Vec<Dim>> probes;  ///< displacements, in the order of the settings
};

/// Where an analysis through time is after a step: who goes on from here comes to the same end, bit for bit.
template <int Dim> struct Checkpoint {
  PathPoint at;                             ///< as it converged, not committed
  std::vector<HistoryStep<Dim>> history{};  ///< every step up to there
  std::uint64_t body = 0;                   ///< tells mesh, nodes and quadrature points from others
};

template <int Dim> struct Result;

/// Where an analysis through time begins, and who hears of its steps.
template <int Dim> struct Steps {
  /// Goes on from here. The analysis throws InputError unless body and sizes are those it has itself; that loads and
  /// materials are the same is up to the caller.
  std::optional<Checkpoint<Dim>> from{};
  /// Called after every step. `so_far` has the approximation; with TimeSettings::fields_every also fields and
  /// `remembered` of the step, else those are empty.
  std::function<void(const Checkpoint<Dim>& there, const Result<Dim>& so_far)> done{};
  int fields_every = 0;  ///< steps whose fields `done` gets: every so many-th; 0: none
};

}  // namespace efree
