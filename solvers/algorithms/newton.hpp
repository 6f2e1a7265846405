// SPDX-License-Identifier: GPL-3.0-or-later
/// Newton's method, and paths of equilibria through time.
#pragma once

#include "efree/core/error.hpp"
#include "efree/core/monitor.hpp"
#include "efree/solvers/equations/equations.hpp"
#include "efree/solvers/linear/linear_solver.hpp"

#include <functional>
#include <string>
#include <vector>

namespace efree {

/// When Newton's method is done, and when it gives up.
struct NewtonOptions {
  double tolerance = 1e-10;  ///< largest OutOfBalance::share
  int max_iterations = 25;
  int max_cuts = 8;  ///< halvings of one change
  /// The factor of a tangent is kept as long as each iteration leaves no more than this share of the forces out of
  /// balance (modified Newton method): cheaper where factors are dear and the start is near. 0: never.
  double keep = 0.0;
};

/// A state in balance.
struct Converged {
  State state;                    ///< not committed
  std::vector<double> residuals;  ///< by iteration: OutOfBalance::share
  Index negative_pivots = 0;      ///< of the last tangent: directions in which the energy falls (an instability)

  int iterations() const { return static_cast<int>(residuals.size()) - 1; }
};

/// The unknown whose residual is largest against what acts there (Equations::force_scale).
struct OutOfBalance {
  OutOfBalance(const Vector& residual, const Vector& scales);
  double share = 0.0, force = 0.0, scale = 0.0;  ///< force = share * scale [force]
};

/// A tangent and its factor, kept from one solve to the next: the pattern is analysed once.
class TangentSolver {
 public:
  /// Refers to both.
  TangentSolver(const Equations& equations, LinearSolver& linear) : equations_(equations), linear_(linear) {}
  /// With the tangent at a state, column by column: the change that takes forces r out of balance away. What the
  /// tangent lacks (Equations::not_in_tangent) is iterated on, with the factor, down to 1e-8 of r (generalised
  /// conjugate residuals; Eisenstat, Elman & Schultz 1983). Of linear equations the tangent is factored once; else
  /// `kept` takes the last one. Throws what the linear solver throws, and NumericalError where thirty of these
  /// iterations leave more than a tenth of r.
  Matrix change(const State& at, const Matrix& r, bool kept = false);
  Index negative_pivots() const { return linear_.negative_pivots(); }

 private:
  void iterate(const State& at, const Vector& r, Eigen::Ref<Vector> change) const;

  const Equations& equations_;
  LinearSolver& linear_;
  SymmetricMatrix K_;
  bool factored_ = false;
};

/// The state at a factor (time), from one in balance. The first change is that of the tangent where it comes from, for
/// what is prescribed in between; changes are cut where the materials have no answer, and where they lead away
/// (line search on the work of the residual on the change; Crisfield 1991, section 9.4). Throws NumericalError saying
/// why if it does not converge.
Converged newton(const Equations& equations, TangentSolver& tangent, const State& from, double factor,
                 const NewtonOptions& options = {});

/// What a step is measured by.
enum class Control {
  load,        ///< time is what steps prescribe: ends where loads have a maximum
  arc_length,  ///< the change of the unknowns: time is found, and may fall (Crisfield 1981): past limit points and back
};
struct PathStep;
/// Steps through time.
struct PathOptions {
  Control control = Control::load;
  double end = 1.0;             ///< [time]
  double step = 0.0;            ///< the first [time]; of arc lengths what they are at the beginning; 0: `end` / 20
  double min_step = 0.0;        ///< 0: a thousandth of the first
  double max_step = 0.0;        ///< 0: `end` / 10, but no less than the first
  double scale = 1.0;           ///< of the first and the largest step, whether they are given or not
  std::vector<double> stops{};  ///< times at which a step ends, ascending: where loads turn; not of arc lengths
  int max_steps = 10000;
  NewtonOptions newton{};
  std::function<bool(const PathStep&)> until{};  ///< asked after every step: true ends the path there

  bool gives_steps() const { return step > 0.0 || max_step > 0.0; }
  double first_step() const { return scale * given_first(); }
  double largest_step() const { return scale * (max_step > 0.0 ? max_step : std::max(given_first(), 0.1 * end)); }
  double least_step() const { return min_step > 0.0 ? min_step : 1e-3 * first_step(); }

 private:
  double given_first() const { return step > 0.0 ? step : 0.05 * end; }
};

/// A path that does not go on.
class PathError : public NumericalError {
 public:
  PathError(const std::string& why, double last, int converged) : NumericalError(why), time(last), steps(converged) {}
  double time;  ///< of the last state in balance
  int steps;    ///< converged before
};

/// A state on a path and all that going on from there needs: the same steps follow, bit for bit, as if it had not
/// ended there. A state alone is the beginning of a path.
struct PathPoint : State {
  int steps = 0;          ///< that led to it
  double next = 0.0;      ///< the step that is tried next [time]; 0: PathOptions::step
  double per_time = 0.0;  ///< of arc lengths: the change of the unknowns per time at the beginning
  double began = 0.0;     ///< where the path began [time]
  double lasted = 0.0;    ///< of arc lengths: the last step [time]
  Vector came_by{};       ///< of arc lengths: the change of the unknowns in the last step
  Vector remembered{};    ///< of arc lengths: the history where the last step began

  PathPoint() = default;
  PathPoint(State state) : State(std::move(state)) {}  // NOLINT: a state is a point
  bool operator==(const PathPoint&) const = default;
};

/// One step of a path, in balance.
struct PathStep {
  State before;     ///< committed
  Converged now;    ///< not committed
  PathPoint after;  ///< committed
};

/// Follows equilibria from a committed state to the end. A step that does not converge, or to what is no answer
/// (Equations::check), is halved; after easy ones (up to five iterations; up to nine near the least size) steps grow by
/// half, after hard ones (ten and more) they shrink. Calls `converged` after every step, and tells monitor.detail of it
/// and of steps that are halved. Throws PathError where steps fall below the least; steps in time then name a limit
/// load where the stiffness along the load is next to nothing beyond (current_stiffness). Returns the last point; one
/// that is at the end already comes back as it is.
PathPoint follow(const Equations& equations, LinearSolver& linear, PathPoint from, const PathOptions& options,
                 const std::function<void(const PathStep&)>& converged = {}, const Monitor& monitor = {});

}  // namespace efree
