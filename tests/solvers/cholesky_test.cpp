// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <array>
#include <memory>
#include <string>
#include <thread>
#include <vector>

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

/// Lower triangle of a definite matrix on a cube of n^3 nodes with three unknowns each, all neighbours coupled.
SymmetricMatrix cube(Index n, std::vector<Index>& node_of) {
  const Index nodes = n * n * n;
  std::vector<Eigen::Triplet<double, Index>> entries;
  node_of.clear();
  for (Index a = 0; a < nodes; ++a) {
    node_of.insert(node_of.end(), 3, a);
    for (Index b = a; b < nodes; ++b) {
      const Index di = std::abs(a % n - b % n), dj = std::abs(a / n % n - b / n % n),
                  dk = std::abs(a / n / n - b / n / n);
      if (std::max({di, dj, dk}) > 1) continue;
      for (int i = 0; i < 3; ++i)
        for (int j = a == b ? i : 0; j < 3; ++j)
          entries.emplace_back(3 * b + j, 3 * a + i, a == b && i == j ? 60.0 : -1.0 / (1.0 + (a + b + i + j) % 5));
    }
  }
  SymmetricMatrix lower(3 * nodes, 3 * nodes);
  lower.setFromTriplets(entries.begin(), entries.end());
  return lower;
}

TEST(Cholesky, LargeFactorsSolveToRoundingWithTheSameBitsOnAnyNumberOfThreads) {
  std::vector<Index> node_of;
  const SymmetricMatrix lower = cube(11, node_of);  // wide enough for supernodes of several panels and tiles
  const Matrix exact = Matrix::Random(lower.rows(), 2), rhs = lower.selfadjointView<Eigen::Lower>() * exact;
  const int threads = num_threads();
  set_num_threads(1);
  const Matrix on_one = Cholesky(lower, node_of).solve(rhs);
  EXPECT_LT((on_one - exact).cwiseAbs().maxCoeff(), 1e-13);
  for (const int count : {2, 3, 7}) {
    set_num_threads(count);
    EXPECT_EQ(Cholesky(lower, node_of).solve(rhs), on_one) << count << " threads";
  }
  set_num_threads(threads);
}

TEST(Cholesky, SolvesToRoundingHoweverManyRightHandSidesThereAre) {
  std::vector<Index> node_of;
  const SymmetricMatrix lower = cube(7, node_of);
  const Cholesky factor(lower, node_of);
  const Matrix exact = Matrix::Random(lower.rows(), 37), rhs = lower.selfadjointView<Eigen::Lower>() * exact;
  for (const Index count : {1, 2, 4, 5, 8, 9, 16, 17, 33, 37})
    EXPECT_LT((factor.solve(rhs.leftCols(count)) - exact.leftCols(count)).cwiseAbs().maxCoeff(), 1e-13) << count;
}

TEST(Cholesky, TheFirstPivotThatFailsIsNamedOnAnyNumberOfThreads) {
  std::vector<Index> node_of;
  SymmetricMatrix lower = cube(8, node_of);
  for (const Index held : {200, 900, 1500}) lower.coeffRef(held, held) = -1.0;
  const auto message = [&] {
    try {
      Cholesky factor(lower, node_of);
    } catch (const NumericalError& error) {
      return std::string(error.what());
    }
    return std::string("none");
  };
  const int threads = num_threads();
  set_num_threads(1);
  const std::string on_one = message();
  EXPECT_THAT(on_one, ::testing::HasSubstr("not positive definite"));
  set_num_threads(2);
  EXPECT_EQ(message(), on_one);
  set_num_threads(threads);
}

TEST(Cholesky, ChainThatHoldsNowhereIsSingular) {
  EXPECT_THAT([] { Cholesky factor(chain(50, 0.0)); },
              ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("not positive definite")));
}

TEST(Cholesky, IndefiniteMatrixIsRefused) {
  EXPECT_THROW(Cholesky factor(chain(5, -3.0)), NumericalError);
}

TEST(LinearSolver, NegativePivotsAreNegativeEigenvalues) {
  // Springs in a row under a dead load: -s on the diagonal takes stiffness until the chain buckles, again and again.
  const Index size = 40;
  const SymmetricMatrix held = chain(size, 1.0);
  const Vector eigenvalues =
      Eigen::SelfAdjointEigenSolver<Matrix>(Matrix(held.selfadjointView<Eigen::Lower>() * Matrix::Identity(size, size)))
          .eigenvalues();
  const std::unique_ptr<LinearSolver> solver = std::make_unique<Cholesky>();
  solver->analyse(held);
  const Matrix rhs = Matrix::Random(size, 2);
  for (const Index lost : {0, 1, 3, 0, 20, 39}) {
    SymmetricMatrix loaded = held;
    const double shift = lost == 0 ? 0.0 : 0.5 * (eigenvalues[lost - 1] + eigenvalues[lost]);
    for (Index i = 0; i < size; ++i) loaded.coeffRef(i, i) -= shift;
    solver->factorize(loaded);
    EXPECT_EQ(solver->negative_pivots(), lost);
    const Matrix product = loaded.selfadjointView<Eigen::Lower>() * solver->solve(rhs);
    EXPECT_LT((product - rhs).cwiseAbs().maxCoeff(), 1e-10) << lost;
  }
}

TEST(LinearSolver, FactorsNewValuesInAnAnalysedPatternAndRefusesAnotherOne) {
  Cholesky solver;
  solver.analyse(chain(30, 1.0));
  for (const double wall : {1.0, 5.0, 0.1}) {
    const SymmetricMatrix lower = chain(30, wall);
    solver.factorize(lower);
    EXPECT_EQ(solver.solve(Vector::Ones(30)), Cholesky(lower).solve(Vector::Ones(30))) << "bit for bit";
  }
  EXPECT_THAT([&] { solver.factorize(chain(31, 1.0)); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("were analysed")));
  SymmetricMatrix elsewhere = chain(30, 1.0);
  elsewhere.coeffRef(29, 28) = 0.0;
  elsewhere.prune([](Index row, Index column, double) { return row != 29 || column != 28; });
  elsewhere.insert(29, 0) = -1.0;
  elsewhere.makeCompressed();
  EXPECT_THAT([&] { solver.factorize(elsewhere); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("elsewhere")));
  EXPECT_THAT([&] { solver.factorize(chain(30, 0.0)); },
              ::testing::ThrowsMessage<NumericalError>(::testing::HasSubstr("singular")));
  EXPECT_THAT([&] { solver.solve(Vector::Ones(30)); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("could not be factored")));
}

TEST(LinearSolver, ThreadsSolveWithOneFactorAtOnce) {
  const Index size = 2000;
  const Cholesky solver(chain(size, 1.0));
  const Matrix rhs = Matrix::Random(size, 8);
  const Matrix one_by_one = solver.solve(rhs);
  std::array<Matrix, 4> found;
  std::vector<std::thread> threads;
  for (Matrix& mine : found)
    threads.emplace_back([&] {
      for (int again = 0; again < 20; ++again) mine = solver.solve(rhs);
    });
  for (std::thread& thread : threads) thread.join();
  for (const Matrix& mine : found) EXPECT_EQ(mine, one_by_one);
}

}  // namespace
}  // namespace efree
