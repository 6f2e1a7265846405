// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/cholesky.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/internal/supernodes.hpp"

#include <cholmod.h>
#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <optional>
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

/// A hash of where entries are.
std::size_t pattern_hash(const SymmetricMatrix& lower) {
  std::size_t hash = 14695981039346656037ULL;  // FNV-1a
  const auto add = [&hash](std::span<const Index> numbers) {
    for (const Index number : numbers) hash = (hash ^ static_cast<std::size_t>(number)) * 1099511628211ULL;
  };
  add({lower.outerIndexPtr(), static_cast<std::size_t>(lower.cols()) + 1});
  add({lower.innerIndexPtr(), static_cast<std::size_t>(lower.nonZeros())});
  return hash;
}

/// CHOLMOD's settings and workspace; a factor is read by as many of them as solve at once.
struct Common {
  cholmod_common common{};
  Common() {
    cholmod_start(&common);
    common.print = 0;
    common.quick_return_if_not_posdef = 1;
  }
  ~Common() { cholmod_finish(&common); }
  Common(const Common&) = delete;
  Common& operator=(const Common&) = delete;
  cholmod_common* get() { return &common; }

  void check(std::size_t unknowns) const {
    if (common.status == CHOLMOD_TOO_LARGE)
      throw InputError(fmt::format(
          "Cholesky factorisation: {} unknowns are too many; use a wider cloud spacing or a coarser mesh", unknowns));
    if (common.status == CHOLMOD_OUT_OF_MEMORY) throw NumericalError("Cholesky factorisation: not enough memory");
    if (common.status < 0)
      throw NumericalError(fmt::format("Cholesky factorisation: CHOLMOD status {}", common.status));
  }
};

}  // namespace

struct Cholesky::Impl {
  Common common;
  cholmod_factor* factor = nullptr;
  std::vector<Index> order;  ///< of the unknowns, if it was given
  std::size_t unknowns = 0, entries = 0;
  std::size_t pattern = 0;               ///< hash of what was analysed
  std::optional<Supernodes> supernodes;  ///< none: simplicial
  bool is_current = false;               ///< whether there are values in the factor
  Index negative = 0;

  /// Threaded BLAS sums in an order that depends on the number of threads.
  Impl() {
    require_blas_memory();
    openblas_set_num_threads(1);
  }
  ~Impl() { cholmod_free_factor(&factor, common.get()); }

  /// Unknowns in the order that CHOLMOD chooses for their nodes (AMD, or METIS where that is better).
  std::vector<Index> node_order(const Pattern& of_nodes, const std::vector<Index>& node_of) {
    const Index nodes = static_cast<Index>(of_nodes.offsets.size()) - 1;
    cholmod_sparse view = symmetric_view(nodes, of_nodes.offsets.data(), of_nodes.rows.data(), nullptr);
    common.common.nmethods = 0;  // CHOLMOD's own strategy, also after an earlier pattern
    const auto free = [this](cholmod_factor* one) { cholmod_free_factor(&one, common.get()); };
    const std::unique_ptr<cholmod_factor, decltype(free)> analysis(cholmod_analyze(&view, common.get()), free);
    common.check(node_of.size());
    const std::span permutation(static_cast<const Index*>(analysis->Perm), static_cast<std::size_t>(nodes));
    std::vector<Index> first(nodes + 1, 0), ordered;
    for (const Index node : node_of) ++first[node + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    ordered.reserve(node_of.size());
    for (const Index node : permutation)
      for (Index unknown = first[node]; unknown < first[node + 1]; ++unknown) ordered.push_back(unknown);
    return ordered;
  }

  static cholmod_sparse view_of(const SymmetricMatrix& lower) {
    return symmetric_view(static_cast<Index>(lower.rows()), lower.outerIndexPtr(), lower.innerIndexPtr(),
                          lower.valuePtr());
  }

  /// Symbolic factor of this kind, with the ordering that there is.
  void prepare(const SymmetricMatrix& lower, bool supernodal) {
    cholmod_sparse view = view_of(lower);
    supernodes.reset();
    cholmod_free_factor(&factor, common.get());
    common.common.supernodal = supernodal ? CHOLMOD_SUPERNODAL : CHOLMOD_SIMPLICIAL;
    common.common.nmethods = order.empty() ? 0 : 1;  // 0: CHOLMOD's own strategy
    if (!order.empty()) common.common.method[0].ordering = CHOLMOD_GIVEN;
    factor = order.empty() ? cholmod_analyze(&view, common.get())
                           : cholmod_analyze_p(&view, order.data(), nullptr, 0, common.get());
    common.check(unknowns);
    require_memory(sizeof(double) * factor_entries(), fmt::format("Cholesky factorisation: {} unknowns", unknowns),
                   "use a wider cloud spacing or a coarser mesh");
    if (supernodal) supernodes.emplace(*factor, lower);
  }
  double factor_entries() const { return static_cast<double>(factor->is_super ? factor->xsize : factor->nzmax); }

  /// Whether all pivots could be divided by.
  bool is_factored(const SymmetricMatrix& lower) {
    if (supernodes) {
      if (factor->xtype == CHOLMOD_PATTERN) cholmod_change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor, common.get());
      common.check(unknowns);
      const Index column = supernodes->factorize(lower, static_cast<double*>(factor->x));
      factor->minor = column == Supernodes::none ? factor->n : static_cast<std::size_t>(column);
      return column == Supernodes::none;
    }
    cholmod_sparse view = view_of(lower);
    on_one_thread([&] { cholmod_factorize(&view, factor, common.get()); });
    common.check(unknowns);
    return common.common.status != CHOLMOD_NOT_POSDEF && factor->minor >= factor->n;
  }
  /// The unknown at which it ended.
  int ended_at() const { return static_cast<const int*>(factor->Perm)[factor->minor]; }
  void require_regular() {
    // Rounding can hide a zero pivot; what it leaves is no stiffness.
    constexpr double smallest_pivot_ratio = 1e-13;
    if (const double ratio = cholmod_rcond(factor, common.get()); ratio < smallest_pivot_ratio)
      throw NumericalError(
          fmt::format("the matrix is singular to working precision (smallest over largest pivot {:.1e})", ratio));
  }
};

Cholesky::Cholesky() : impl_(std::make_unique<Impl>()) {}
Cholesky::Cholesky(const SymmetricMatrix& lower, const std::vector<Index>& node_of) : Cholesky() {
  analyse(lower, node_of);
  factorize_definite(lower);
}
Cholesky::~Cholesky() = default;
Cholesky::Cholesky(Cholesky&&) noexcept = default;
Cholesky& Cholesky::operator=(Cholesky&&) noexcept = default;

void Cholesky::analyse(const SymmetricMatrix& pattern, const std::vector<Index>& node_of) {
  impl_->unknowns = static_cast<std::size_t>(pattern.rows());
  impl_->entries = static_cast<std::size_t>(pattern.nonZeros());
  impl_->pattern = pattern_hash(pattern);
  impl_->is_current = false;
  impl_->order.clear();
  if (!node_of.empty()) {
    require(static_cast<Index>(node_of.size()) == pattern.rows() && std::ranges::is_sorted(node_of),
            "Cholesky: a node for each unknown expected, ascending");
    impl_->order = impl_->node_order(node_pattern(pattern, node_of), node_of);
  }
  impl_->prepare(pattern, true);
}

/// Refuses what was not analysed, and forgets the last factor.
void Cholesky::begin(const SymmetricMatrix& lower) {
  if (static_cast<std::size_t>(lower.rows()) != impl_->unknowns ||
      static_cast<std::size_t>(lower.nonZeros()) != impl_->entries)
    throw InputError(fmt::format("Cholesky: {} entries in {} rows, but {} in {} were analysed", lower.nonZeros(),
                                 lower.rows(), impl_->entries, impl_->unknowns));
  require(pattern_hash(lower) == impl_->pattern,
          "Cholesky: entries are elsewhere than in the pattern that was analysed");
  impl_->is_current = false;
  impl_->negative = 0;
  if (!impl_->factor->is_super) impl_->prepare(lower, true);
}

void Cholesky::factorize_definite(const SymmetricMatrix& lower) {
  if (!factorize_if_definite(lower))
    throw NumericalError(
        fmt::format("the matrix is not positive definite (at unknown {} of {})", impl_->ended_at(), lower.rows()));
}

bool Cholesky::factorize_if_definite(const SymmetricMatrix& lower) {
  begin(lower);
  if (!impl_->is_factored(lower)) return false;
  impl_->require_regular();
  return impl_->is_current = true;
}

void Cholesky::factorize(const SymmetricMatrix& lower) {
  begin(lower);
  if (!impl_->is_factored(lower)) {
    impl_->prepare(lower, false);
    if (!impl_->is_factored(lower))
      throw NumericalError(
          fmt::format("the matrix is singular (at unknown {} of {})", impl_->ended_at(), lower.rows()));
    const auto* offsets = static_cast<const int*>(impl_->factor->p);
    const auto* values = static_cast<const double*>(impl_->factor->x);
    for (std::size_t column = 0; column < impl_->unknowns; ++column) impl_->negative += values[offsets[column]] < 0.0;
  }
  impl_->require_regular();
  impl_->is_current = true;
}

Index Cholesky::negative_pivots() const {
  return impl_->negative;
}

Matrix Cholesky::solve(const Eigen::Ref<const Matrix>& B) const {
  if (B.rows() != static_cast<Eigen::Index>(impl_->unknowns))
    throw InputError(fmt::format("Cholesky solve: {} rows, expected {}", B.rows(), impl_->unknowns));
  require(impl_->is_current, "Cholesky solve: there is no factor, or the last matrix could not be factored");
  if (B.cols() == 0) return B;
  Matrix copy = B;
  cholmod_dense view{};
  view.nrow = view.d = static_cast<std::size_t>(copy.rows());
  view.ncol = static_cast<std::size_t>(copy.cols());
  view.nzmax = view.nrow * view.ncol;
  view.x = copy.data();
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
  Common own;  // others may solve at the same time
  cholmod_dense* X = cholmod_solve(CHOLMOD_A, impl_->factor, &view, own.get());
  own.check(impl_->unknowns);
  copy = Eigen::Map<const Matrix>(static_cast<const double*>(X->x), copy.rows(), copy.cols());
  cholmod_free_dense(&X, own.get());
  return copy;
}

double Cholesky::factor_entries() const {
  return impl_->factor_entries();
}

}  // namespace efree
