// SPDX-License-Identifier: GPL-3.0-or-later
/// What algorithms see of a problem, whatever its physics: states, residuals, tangents.
#pragma once

#include "efree/assembly/operators.hpp"

#include <filesystem>
#include <vector>

namespace efree {

/// All that a solution is at one moment.
struct State {
  Vector u;             ///< coefficients, degree of freedom = Dim * node + component [length]
  Vector history;       ///< what the materials remember, as of the last commit
  double time = 0.0;    ///< [time]
  double dt = 0.0;      ///< time since the last commit
  double factor = 0.0;  ///< of the loads and of what is prescribed

  bool operator==(const State&) const = default;
};

/// Writes a state, bit for bit; what was in the file stays until the new one is complete. Throws InputError if the file
/// cannot be written.
void write_state(const State& state, const std::filesystem::path& file);
/// Throws InputError for a file that cannot be read, is no state or not a whole one.
State read_state(const std::filesystem::path& file);

/// r(u, factor) = 0. Equations know no algorithm; they do not change, and any number of threads may ask them.
class Equations {
 public:
  virtual ~Equations() = default;

  /// Nothing has happened yet.
  virtual State rest() const = 0;
  /// The state under another factor, with what is prescribed on nodal values; the unknowns stay.
  virtual State under(double factor, State state) const = 0;
  /// The state with a change of the unknowns.
  virtual State moved(State state, const Vector& change) const = 0;
  /// Forces that are not in balance, by unknown [force]: internal less external ones. Throws what materials throw.
  virtual Vector residual(const State& state) const = 0;
  /// Forces out of balance at `to` (the same unknowns under another factor) if what was prescribed in between is taken
  /// as a small change of `from`: what Newton's method starts a step with, whatever jumps are prescribed.
  virtual Vector first_residual(const State& /*from*/, const State& to) const { return residual(to); }
  /// Whether forces change between two times, not only what is prescribed.
  virtual bool loads_change(double /*from*/, double /*to*/) const { return true; }
  /// What the residual of each unknown is small or large against: the forces that act on its node, each by itself
  /// [force].
  virtual Vector force_scale(const State& state) const = 0;
  /// The derivative of the residual by the unknowns, or its symmetric part; lower triangle. K is empty, or from the
  /// same equations: then its values are replaced in place.
  virtual void tangent(const State& state, SymmetricMatrix& K) const = 0;
  /// What the tangent lacks, times a change of the unknowns: of a derivative that is not symmetric. Empty for nothing,
  /// and what is not known.
  virtual Vector not_in_tangent(const State& /*state*/, const Vector& /*change*/) const { return {}; }
  /// Throws NumericalError, saying why, for a state in balance that is no answer all the same.
  virtual void check(const State& /*balanced*/) const {}
  /// The state with the histories that the materials have at its end.
  virtual State commit(State state) const = 0;

  /// Whether the residual is linear in u: the tangent is the same for every state.
  virtual bool linear() const = 0;
  /// The node of each unknown; ascending.
  virtual const std::vector<Index>& node_of_unknowns() const = 0;
};

}  // namespace efree
