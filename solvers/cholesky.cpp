// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cholesky.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include <cholmod.h>
#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <span>

extern "C" void openblas_set_num_threads(int);

namespace efree {
namespace {

/// Lower triangle by columns: which blocks of the matrix, one for each pair of nodes, hold entries.
struct Pattern {
  std::vector<Index> offsets{0}, rows;
};
Pattern node_pattern(const SymmetricMatrix& lower, const std::vector<Index>& node_of) {
  Pattern pattern;
  std::vector<Index> last_seen_by(node_of.back() + 1, -1);
  for (Index column = 0; column < lower.cols();) {
    const Index node = node_of[column];
    while (static_cast<Index>(pattern.offsets.size()) <= node)  // of numbers without unknowns
      pattern.offsets.push_back(static_cast<Index>(pattern.rows.size()));
    for (; column < lower.cols() && node_of[column] == node; ++column)
      for (SymmetricMatrix::InnerIterator entry(lower, column); entry; ++entry)
        if (Index& seen = last_seen_by[node_of[entry.row()]]; seen != node) {
          seen = node;
          pattern.rows.push_back(node_of[entry.row()]);
        }
    pattern.offsets.push_back(static_cast<Index>(pattern.rows.size()));
  }
  return pattern;
}

/// A symmetric matrix as CHOLMOD takes it; `values` null: the pattern alone.
cholmod_sparse symmetric_view(Index size, const Index* offsets, const Index* rows, const double* values) {
  cholmod_sparse view{};
  view.nrow = view.ncol = static_cast<std::size_t>(size);
  view.nzmax = static_cast<std::size_t>(offsets[size]);
  view.p = const_cast<Index*>(offsets);
  view.i = const_cast<Index*>(rows);
  view.x = const_cast<double*>(values);
  view.stype = -1;
  view.itype = CHOLMOD_INT;
  view.xtype = values ? CHOLMOD_REAL : CHOLMOD_PATTERN;
  view.dtype = CHOLMOD_DOUBLE;
  view.sorted = values != nullptr;
  view.packed = 1;
  return view;
}

}  // namespace

struct Cholesky::Impl {
  mutable cholmod_common common{};
  cholmod_factor* factor = nullptr;

  Impl() {
    openblas_set_num_threads(1);  // threaded BLAS sums in an order that depends on the number of threads
    cholmod_start(&common);
    common.print = 0;
    common.supernodal = CHOLMOD_SUPERNODAL;
    common.quick_return_if_not_posdef = 1;
  }
  ~Impl() {
    cholmod_free_factor(&factor, &common);
    cholmod_finish(&common);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  /// Unknowns in the order that CHOLMOD chooses for their nodes (AMD, or METIS where that is better).
  std::vector<Index> node_order(const Pattern& pattern, const std::vector<Index>& node_of) {
    const Index nodes = static_cast<Index>(pattern.offsets.size()) - 1;
    cholmod_sparse view = symmetric_view(nodes, pattern.offsets.data(), pattern.rows.data(), nullptr);
    const auto free = [this](cholmod_factor* one) { cholmod_free_factor(&one, &common); };
    const std::unique_ptr<cholmod_factor, decltype(free)> analysis(cholmod_analyze(&view, &common), free);
    check(node_of.size());
    const std::span permutation(static_cast<const Index*>(analysis->Perm), static_cast<std::size_t>(nodes));
    std::vector<Index> first(nodes + 1, 0), order;
    for (const Index node : node_of) ++first[node + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    order.reserve(node_of.size());
    for (const Index node : permutation)
      for (Index unknown = first[node]; unknown < first[node + 1]; ++unknown) order.push_back(unknown);
    return order;
  }

  void check(std::size_t unknowns) const {
    if (common.status == CHOLMOD_TOO_LARGE)
      throw InputError(fmt::format(
          "Cholesky factorisation: {} unknowns are too many; use a wider cloud spacing or a coarser mesh", unknowns));
    if (common.status == CHOLMOD_OUT_OF_MEMORY) throw NumericalError("Cholesky factorisation: not enough memory");
    if (common.status < 0)
      throw NumericalError(fmt::format("Cholesky factorisation: CHOLMOD status {}", common.status));
  }
};

Cholesky::Cholesky(const SymmetricMatrix& lower, const std::vector<Index>& node_of) : impl_(std::make_unique<Impl>()) {
  cholmod_sparse view =
      symmetric_view(static_cast<Index>(lower.rows()), lower.outerIndexPtr(), lower.innerIndexPtr(), lower.valuePtr());
  if (node_of.empty()) {
    impl_->factor = cholmod_analyze(&view, &impl_->common);
  } else {
    require(static_cast<Index>(node_of.size()) == lower.rows() && std::ranges::is_sorted(node_of),
            "Cholesky: a node for each unknown expected, ascending");
    std::vector<Index> order = impl_->node_order(node_pattern(lower, node_of), node_of);
    impl_->common.nmethods = 1;
    impl_->common.method[0].ordering = CHOLMOD_GIVEN;
    impl_->factor = cholmod_analyze_p(&view, order.data(), nullptr, 0, &impl_->common);
  }
  const auto unknowns = static_cast<std::size_t>(lower.rows());
  impl_->check(unknowns);
  require_memory(sizeof(double) * factor_entries(), fmt::format("Cholesky factorisation: {} unknowns", lower.rows()),
                 "use a wider cloud spacing or a coarser mesh");
  on_one_thread([&] { cholmod_factorize(&view, impl_->factor, &impl_->common); });
  impl_->check(unknowns);
  if (impl_->common.status == CHOLMOD_NOT_POSDEF || impl_->factor->minor < impl_->factor->n) {
    const auto* permutation = static_cast<const int*>(impl_->factor->Perm);
    throw NumericalError(fmt::format("the matrix is not positive definite (at unknown {} of {})",
                                     permutation[impl_->factor->minor], lower.rows()));
  }
  // Rounding can hide a zero pivot; what it leaves is no stiffness.
  constexpr double smallest_pivot_ratio = 1e-13;
  if (const double ratio = cholmod_rcond(impl_->factor, &impl_->common); ratio < smallest_pivot_ratio)
    throw NumericalError(
        fmt::format("the matrix is singular to working precision (smallest over largest pivot {:.1e})", ratio));
}

Cholesky::~Cholesky() = default;
Cholesky::Cholesky(Cholesky&&) noexcept = default;
Cholesky& Cholesky::operator=(Cholesky&&) noexcept = default;

Matrix Cholesky::solve(const Eigen::Ref<const Matrix>& B) const {
  if (B.rows() != static_cast<Eigen::Index>(impl_->factor->n))
    throw InputError(fmt::format("Cholesky solve: {} rows, expected {}", B.rows(), impl_->factor->n));
  Matrix copy = B;
  cholmod_dense view{};
  view.nrow = view.d = static_cast<std::size_t>(copy.rows());
  view.ncol = static_cast<std::size_t>(copy.cols());
  view.nzmax = view.nrow * view.ncol;
  view.x = copy.data();
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* X = cholmod_solve(CHOLMOD_A, impl_->factor, &view, &impl_->common);
  impl_->check(impl_->factor->n);
  copy = Eigen::Map<const Matrix>(static_cast<const double*>(X->x), copy.rows(), copy.cols());
  cholmod_free_dense(&X, &impl_->common);
  return copy;
}

double Cholesky::factor_entries() const {
  return static_cast<double>(impl_->factor->is_super ? impl_->factor->xsize : impl_->factor->nzmax);
}

}  // namespace efree
