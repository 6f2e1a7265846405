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

TEST(Cholesky, OrderingByNodesGivesTheSameSolutionFromAFactorAsSparse) {
  // Grid of n x n nodes with three unknowns each, less those of node 7 and two of node 11.
  const Index n = 30;
  std::vector<Index> node_of;
  for (Index node = 0; node < n * n; ++node)
    for (int k = 0; k < (node == 7 ? 0 : node == 11 ? 1 : 3); ++k) node_of.push_back(node);
  const Index size = static_cast<Index>(node_of.size());
  SymmetricMatrix lower(size, size);
  std::vector<Eigen::Triplet<double, Index>> entries;
  for (Index c = 0; c < size; ++c)
    for (Index r = c; r < size; ++r) {
      const Index di = std::abs(node_of[r] % n - node_of[c] % n), dj = std::abs(node_of[r] / n - node_of[c] / n);
      if (di <= 1 && dj <= 1) entries.emplace_back(r, c, r == c ? 30.0 : -1.0 / (1.0 + r % 3 + c % 2));
    }
  lower.setFromTriplets(entries.begin(), entries.end());
  const Cholesky by_nodes(lower, node_of), by_unknowns(lower);
  const Matrix rhs = Matrix::Random(size, 2);
  EXPECT_LT((by_nodes.solve(rhs) - by_unknowns.solve(rhs)).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_LT(by_nodes.factor_entries(), 1.2 * by_unknowns.factor_entries());
  EXPECT_THROW(Cholesky(lower, std::vector<Index>(3, 0)), InputError);
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
