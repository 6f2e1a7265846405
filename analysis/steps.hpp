// SPDX-License-Identifier: GPL-3.0-or-later
/// What is known of an analysis through time while it goes on, and where it can be taken up again.
#pragma once

#include "efree/assembly/resultants.hpp"
#include "efree/solvers/algorithms/newton.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
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

/// How far linear elasticity is from all that the materials say, at one time: by a step of Newton's method from the
/// linear answer on the equations of the cloud, whose error is of higher order.
struct LinearCheck {
  double time = 0.0;
  bool enough = false;        ///< all of the next three within the tolerance, and the body stable
  double displacement = 0.0;  ///< largest difference over the largest displacement
  double stress = 0.0;        ///< likewise, of the stresses of a region (true ones at finite strains)
  double overload = 1.0;      ///< largest stress over what is borne, along its return, where a material flows
  double strain = 0.0;        ///< of the linear answer: largest change of a length
  double rotation = 0.0;      ///< likewise [rad]
  Index negative_pivots = 0;  ///< of the tangent there: above 0 the body is not stable
  bool same = false;          ///< forces and stresses, to rounding: then there is no difference
  std::string failure{};      ///< why the materials have no answer there; empty if they have one

  bool operator==(const LinearCheck&) const = default;
};
/// The same in words.
std::string text_of(const LinearCheck& check);

/// Where an analysis through time is after a step: who goes on from here comes to the same end, bit for bit.
template <int Dim> struct Checkpoint {
  PathPoint at;                              ///< as it converged, not committed
  std::vector<HistoryStep<Dim>> history{};   ///< every step up to there
  std::uint64_t body = 0;                    ///< tells mesh, nodes and quadrature points from others
  std::vector<LinearCheck> linear_checks{};  ///< with Regime::automatic, in the order of time
  /// As long as linear elasticity is enough, which `at` is of then: up to where the full model agrees with it to
  /// rounding, and from where that goes on once it is not.
  std::optional<PathPoint> agreed{};
  double scale = 1.0, elastic_range = 1.0;  ///< of the steps: PathOptions::scale, TimeSettings::elastic_range
  Vector mode{};  ///< of the first step at which the body was not stable (softest_mode); empty before
};

template <int Dim> struct Result;

/// Where an analysis through time begins, and who hears of its steps.
template <int Dim> struct Steps {
  /// Goes on from here. The analysis throws InputError unless body and sizes are those it has itself; that loads and
  /// materials are the same is up to the caller.
  std::optional<Checkpoint<Dim>> from{};
  /// `from` may be of another mesh or cloud: then the path begins at rest, and `done` is not called.
  bool from_another = false;
  /// Called after every step; with Regime::automatic the number falls once where the full model takes steps again.
  /// `so_far` has the approximation; with fields_every also fields and `remembered` of the step, else those are empty.
  std::function<void(const Checkpoint<Dim>& there, const Result<Dim>& so_far)> done{};
  /// The same path by a coarser cloud or mesh, to estimate the errors of this one by; empty: a coarser cloud is solved.
  std::shared_ptr<const Result<Dim>> coarser{};
  int fields_every = 0;  ///< steps whose fields `done` gets: every so many-th; 0: none
};

}  // namespace efree
