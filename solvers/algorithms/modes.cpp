// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/algorithms/modes.hpp"

#include "efree/core/internal/spectrum.hpp"
#include "efree/solvers/linear/cholesky.hpp"

#include <algorithm>
#include <random>

namespace efree {

Vector softest_mode(const Equations& equations, const State& at) {
  constexpr int iterations = 20;
  SymmetricMatrix K;
  equations.tangent(at, K);
  Cholesky factor;
  factor.analyse(K, equations.node_of_unknowns());
  factor.factorize(K);
  const Index size = static_cast<Index>(K.rows());
  const Index count = std::min({factor.negative_pivots() + 2, Index{8}, size});
  std::mt19937 random(1);
  Matrix X(size, count);
  for (double& entry : X.reshaped()) entry = static_cast<double>(random()) / std::mt19937::max() - 0.5;
  for (int k = 0; k < iterations; ++k) {
    X = factor.solve(X);
    X = internal::orthonormal_columns(X);
    const Matrix projected = X.transpose() * (K.selfadjointView<Eigen::Lower>() * X);
    X *= internal::spectrum<Eigen::Dynamic>(projected).vectors;  // values ascend
  }
  State nowhere = at;
  nowhere.u.setZero();
  Vector mode = equations.moved(nowhere, X.col(0)).u;
  Index largest;
  mode.cwiseAbs().maxCoeff(&largest);
  return mode / mode[largest];
}

}  // namespace efree
