// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cholesky.hpp"
#include "efree/core/error.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace efree {
namespace {

/// Lower triangle of the stiffness of a chain of `size` springs, the first one held to the wall by `wall`.
SymmetricMatrix chain(Index size, double wall) {
  SymmetricMatrix lower(size, size);
  for (Index i = 0; i < size; ++i) {
    lower.insert(i, i) = (i == 0 ? wall : 1.0) + (i + 1 < size ? 1.0 : 0.0);
    if (i + 1 < size) lower.insert(i + 1, i) = -1.0;
  }
  lower.makeCompressed();
  return lower;
}

TEST(Cholesky, SolvesSeveralRightHandSidesAtOnce) {
  const SymmetricMatrix lower = chain(50, 1.0);
  const Cholesky factor(lower);
  const Matrix exact = Matrix::Random(50, 4), rhs = lower.selfadjointView<Eigen::Lower>() * exact;
  const Matrix found = factor.solve(rhs);
  EXPECT_LT((found - exact).cwiseAbs().maxCoeff(), 1e-12);
  for (Index k = 0; k < 4; ++k) EXPECT_LT((factor.solve(rhs.col(k)) - exact.col(k)).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_GE(factor.factor_entries(), 99.0);
}

TEST(Cholesky, ChainThatHoldsNowhereIsSingular) {
  EXPECT_THAT([] { Cholesky factor(chain(50, 0.0)); },
              ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("not positive definite")));
}

TEST(Cholesky, IndefiniteMatrixIsRefused) {
  EXPECT_THROW(Cholesky factor(chain(5, -3.0)), NumericalError);
}

}  // namespace
}  // namespace efree
