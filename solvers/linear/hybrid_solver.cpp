// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/hybrid_solver.hpp"

#include "efree/core/error.hpp"
#include "efree/solvers/linear/cholesky.hpp"
#include "efree/solvers/linear/internal/conjugate_gradients.hpp"
#include "efree/solvers/linear/internal/node_graph.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <atomic>
#include <mutex>
#include <optional>
#include <random>
#include <span>
#include <utility>

namespace efree {
namespace {

/// Share of all possible entries from which on a factor is nearly full.
constexpr double full = 0.1;
/// What an iteration takes for each number that it reads, in operations on a factor, and the iterations that a factor
/// has to be worth (docs/evidence.md, "Tangents without a factor").
constexpr double operations_per_number = 10.0, worth = 250.0;

}  // namespace

struct HybridSolver::Impl {
  Cholesky cholesky;
  std::optional<ConjugateGradients> iterative;  ///< none: all matrices are factored
  int most = 0;                                 ///< iterations that are worth it
  SymmetricMatrix matrix;                       ///< the last; where all are factored none is kept
  std::atomic<bool> factored = false;
  std::atomic<bool> taken = false;  ///< whether iterations have the last matrix
  std::mutex asked;

  /// Iterations with the last matrix; nothing if a factor has to do it, which there is then.
  std::optional<Vector> by_iterations(const Vector& b) {
    const std::lock_guard lock(asked);
    if (factored) return std::nullopt;
    auto x = iterative->solve(matrix, b, HybridSolver::tolerance, most);
    if (!x) factor(matrix);
    return x;
  }
  void factor(const SymmetricMatrix& lower) {
    cholesky.factorize(lower);
    factored = true;
  }
};

HybridSolver::HybridSolver() : impl_(std::make_unique<Impl>()) {}
HybridSolver::~HybridSolver() = default;
HybridSolver::HybridSolver(HybridSolver&&) noexcept = default;
HybridSolver& HybridSolver::operator=(HybridSolver&&) noexcept = default;

void HybridSolver::analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of) {
  impl_->factored = impl_->taken = false;
  impl_->iterative.reset();
  impl_->matrix = {};
  impl_->cholesky.analyse(pattern, node_of);
  const double size = static_cast<double>(pattern.rows());
  if (impl_->cholesky.factor_entries() < full * 0.5 * size * size) return;
  NodeGraph graph = node_graph(pattern, node_of);
  if (!has_whole_blocks(pattern, graph)) return;
  const double most =
      impl_->cholesky.operations() / (operations_per_number * ConjugateGradients::numbers(graph, pattern.nonZeros()));
  if (!(most >= worth)) return;
  impl_->iterative.emplace(std::move(graph));
  impl_->matrix = pattern;
  impl_->most = static_cast<int>(most);
}

void HybridSolver::factorize(const SymmetricMatrix& lower) {
  Impl& my = *impl_;
  my.factored = my.taken = false;
  if (!my.iterative) return my.factor(lower);
  const auto rows_of = [](const SymmetricMatrix& of) {
    return std::span(of.innerIndexPtr(), static_cast<std::size_t>(of.nonZeros()));
  };
  require(lower.rows() == my.matrix.rows() && std::ranges::equal(rows_of(lower), rows_of(my.matrix)),
          "linear solver: entries are elsewhere than in the pattern that was analysed");
  my.matrix.coeffs() = lower.coeffs();
  if (my.iterative->take(lower))
    my.taken = true;
  else
    my.factor(lower);
}

Index HybridSolver::negative_pivots() const {
  if (impl_->taken && !impl_->factored) {
    std::mt19937 random(1);
    Vector b(impl_->matrix.rows());
    for (double& entry : b) entry = static_cast<double>(random()) / std::mt19937::max() - 0.5;
    if (impl_->by_iterations(b)) return 0;
  }
  return impl_->cholesky.negative_pivots();
}

Matrix HybridSolver::solve(const Eigen::Ref<const Matrix>& B) const {
  if (impl_->factored || !impl_->taken) return impl_->cholesky.solve(B);
  if (B.rows() != impl_->matrix.rows())
    throw InputError(fmt::format("linear solver: {} rows, expected {}", B.rows(), impl_->matrix.rows()));
  Matrix X(B.rows(), B.cols());
  for (Index k = 0; k < B.cols(); ++k) {
    const auto x = impl_->by_iterations(B.col(k));
    X.col(k) = x ? *x : Vector(impl_->cholesky.solve(B.col(k)).col(0));
  }
  return X;
}

bool HybridSolver::has_factor() const {
  return impl_->factored;
}

}  // namespace efree
