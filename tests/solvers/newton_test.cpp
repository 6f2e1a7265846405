// SPDX-License-Identifier: GPL-3.0-or-later
/// Newton's method and paths on equations of a few unknowns.
#include "efree/solvers/algorithms/newton.hpp"
#include "efree/core/error.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// r(u, t) of as many unknowns as nodes; forces are compared with 1.
class Toy : public Equations {
 public:
  explicit Toy(Index unknowns) : nodes_(unknowns) { std::iota(nodes_.begin(), nodes_.end(), 0); }
  State rest() const override { return {.u = Vector::Zero(static_cast<Eigen::Index>(nodes_.size())), .history = {}}; }
  State under(double time, State state) const override {
    state.time = time;
    return state;
  }
  State moved(State state, const Vector& change) const override {
    state.u += change;
    return state;
  }
  Vector force_scale(const State& state) const override { return Vector::Ones(state.u.size()); }
  State commit(State state) const override { return state; }
  bool linear() const override { return false; }
  const std::vector<Index>& node_of_unknowns() const override { return nodes_; }

 private:
  std::vector<Index> nodes_;
};

/// r = (u - t) (u - t + 1/2): the path u = t, and beside it one that is no answer, to which long steps lead.
class TwoPaths final : public Toy {
 public:
  TwoPaths() : Toy(1) {}
  Vector residual(const State& at) const override {
    const double off = at.u[0] - at.time;
    return Vector::Constant(1, off * (off + 0.5));
  }
  void tangent(const State& at, SymmetricMatrix& K) const override {
    K.resize(1, 1);
    K.coeffRef(0, 0) = 2.0 * (at.u[0] - at.time) + 0.5;
    K.makeCompressed();
  }
  void check(const State& balanced) const override {
    if (balanced.u[0] < balanced.time - 0.25) throw NumericalError("that is the other path");
  }
};

/// r = u - t with a tangent that is not quite its: an eighth is left each time, never nothing in five iterations.
class Stiff final : public Toy {
 public:
  Stiff() : Toy(1) {}
  Vector residual(const State& at) const override { return Vector::Constant(1, at.u[0] - at.time); }
  void tangent(const State&, SymmetricMatrix& K) const override {
    K.resize(1, 1);
    K.coeffRef(0, 0) = 1.15;
    K.makeCompressed();
  }
};

TEST(Path, StepsOfTheLeastSizeGrowThoughTheyAreNotEasy) {
  const Stiff equations;
  Cholesky solver;
  PathOptions options{.step = 1e-2, .min_step = 1e-2, .max_step = 0.5};
  options.newton.tolerance = 1e-9;
  std::vector<int> iterations;
  std::vector<double> times;
  follow(equations, solver, PathPoint(equations.rest()), options, [&](const PathStep& step) {
    iterations.push_back(step.now.iterations());
    times.push_back(step.after.time);
  });
  EXPECT_GT(iterations.front(), 5);
  EXPECT_LT(times.size(), 60u);  // a hundred of that size
}

TEST(Path, AStepThatLeadsToNoAnswerIsHalved) {
  const TwoPaths equations;
  std::vector<double> times;
  const auto path = [&](double min_step) {
    times.clear();
    Cholesky linear;
    return follow(equations, linear, equations.rest(), {.step = 1.0, .min_step = min_step}, [&](const PathStep& step) {
      times.push_back(step.now.state.time);
      EXPECT_NEAR(step.now.state.u[0], step.now.state.time, 1e-9);
    });
  };
  EXPECT_NEAR(path(0.01).u[0], 1.0, 1e-9);
  EXPECT_GT(times.size(), 2u);
  EXPECT_LT(times.front(), 0.6);
  EXPECT_THAT([&] { path(0.6); }, ThrowsMessage<PathError>(HasSubstr("do not converge: that is the other path")));
  EXPECT_TRUE(times.empty());
}

/// r = (1 + S) u - t f with S = - S^T, of rotations by all angles up to `largest`; the tangent is 1.
class Turning final : public Toy {
 public:
  Turning(Index pairs, double largest) : Toy(2 * pairs), S_(Matrix::Zero(2 * pairs, 2 * pairs)) {
    for (Index k = 0; k < pairs; ++k) {
      S_(2 * k, 2 * k + 1) = largest * (k + 1) / pairs;
      S_(2 * k + 1, 2 * k) = -S_(2 * k, 2 * k + 1);
    }
  }
  Vector residual(const State& at) const override { return at.u + S_ * at.u - at.time * Vector::Ones(at.u.size()); }
  void tangent(const State& at, SymmetricMatrix& K) const override {
    K.resize(at.u.size(), at.u.size());
    K.setIdentity();
  }
  Vector not_in_tangent(const State& /*state*/, const Vector& change) const override { return S_ * change; }

 private:
  Matrix S_;
};

TEST(Newton, WhatIsNotSymmetricIsIteratedOnAndRefusedWhereThatLeadsNowhere) {
  const auto solve = [](double largest) {
    const Turning equations(100, largest);
    Cholesky linear;
    TangentSolver tangent(equations, linear);
    const Converged there = newton(equations, tangent, equations.rest(), 1.0);
    EXPECT_LT(equations.residual(there.state).cwiseAbs().maxCoeff(), 1e-9);
    return there.iterations();
  };
  EXPECT_EQ(solve(1.0), 1);  // 1e-8 by the first change
  EXPECT_GT(solve(8.0), 2);  // thirty directions leave less than a tenth
  const Turning equations(100, 1.0);
  Cholesky linear;
  const Vector nothing = Vector::Zero(200);
  EXPECT_EQ(TangentSolver(equations, linear).change(equations.rest(), nothing), Matrix(nothing));
  EXPECT_THAT([&] { solve(200.0); }, ThrowsMessage<NumericalError>(HasSubstr("too far from symmetric")));
}

}  // namespace
}  // namespace efree
