// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/cholesky.hpp"

#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/solvers/linear/internal/node_graph.hpp"
#include "efree/solvers/linear/internal/supernodes.hpp"

#include <cholmod.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>

extern "C" void openblas_set_num_threads(int);

namespace efree {
namespace {

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

/// A dense matrix, by columns, as CHOLMOD takes it.
cholmod_dense dense_view(const double* values, Eigen::Index rows, Eigen::Index columns, Eigen::Index stride) {
  cholmod_dense view{};
  view.nrow = static_cast<std::size_t>(rows);
  view.ncol = static_cast<std::size_t>(columns);
  view.d = static_cast<std::size_t>(stride);
  view.nzmax = view.d * view.ncol;
  view.x = const_cast<double*>(values);
  view.xtype = CHOLMOD_REAL;
  view.dtype = CHOLMOD_DOUBLE;
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

  [[noreturn]] static void refuse(std::size_t unknowns) {
    throw InputError(fmt::format(
        "Cholesky factorisation: {} unknowns are too many; use a wider cloud spacing or a coarser mesh", unknowns));
  }
  void check(std::size_t unknowns) const {
    if (common.status == CHOLMOD_TOO_LARGE) refuse(unknowns);
    if (common.status == CHOLMOD_OUT_OF_MEMORY) throw NumericalError("Cholesky factorisation: not enough memory");
    if (common.status < 0)
      throw NumericalError(fmt::format("Cholesky factorisation: CHOLMOD status {}", common.status));
  }
};

}  // namespace

struct Cholesky::Impl {
  /// A factor of CHOLMOD's, to be freed with its settings.
  struct Free {
    cholmod_common* common;
    void operator()(cholmod_factor* factor) const { cholmod_free_factor(&factor, common); }
  };
  using Factor = std::unique_ptr<cholmod_factor, Free>;

  Common common;
  Factor of_nodes = own(nullptr);  ///< analysis of the graph of nodes
  std::vector<Index> first;        ///< unknown of each node; one past the last
  Factor factor = own(nullptr);
  std::size_t unknowns = 0, entries = 0;
  std::size_t pattern = 0;  ///< hash of what was analysed
  std::optional<Supernodes> supernodes;
  std::vector<double> signs;  ///< of the pivots, in the order of the factor; empty: all positive
  bool is_current = false;    ///< whether there are values in the factor
  double operations = 0.0;    ///< of a supernodal factor
  Index negative = 0;

  /// Threaded BLAS sums in an order that depends on the number of threads.
  Impl() {
    require_blas_memory();
    openblas_set_num_threads(1);
  }
  Factor own(cholmod_factor* one) { return Factor(one, Free{common.get()}); }

  /// Orders the nodes and finds the supernodes of their graph. All unknowns of a node meet those of its neighbours, so
  /// the supernodes of the matrix are the same; it has up to nine times the entries.
  void analyse_nodes(NodeGraph graph) {
    const double per_node = static_cast<double>(unknowns) / std::max<Index>(1, graph.size());
    cholmod_sparse view = symmetric_view(graph.size(), graph.offsets.data(), graph.rows.data(), nullptr);
    Common defaults;  // CHOLMOD's widths below which supernodes are joined, in unknowns
    for (std::size_t k = 0; k < std::size(defaults.common.nrelax); ++k)
      common.common.nrelax[k] = static_cast<std::size_t>(std::lround(defaults.common.nrelax[k] / per_node));
    common.common.supernodal = CHOLMOD_SUPERNODAL;
    if (const Followers all = followers(graph); all.are_mostly_between_two()) {
      analyse_leaders(all, per_node, view);
    } else {
      common.common.nmethods = 0;  // AMD, or METIS where that is better; also after an earlier pattern
      of_nodes = own(cholmod_analyze(&view, common.get()));
      common.check(unknowns);
    }
    first = std::move(graph.first);
  }
  /// Orders the nodes that others follow: by AMD, and where a factor takes so many operations for each of them that it
  /// is worth it, by METIS. `nodes`: the graph of all.
  void analyse_leaders(const Followers& all, double per_node, cholmod_sparse& nodes) {
    constexpr double worth_metis = 2.5e5;
    cholmod_sparse view = symmetric_view(all.size(), all.offsets.data(), all.rows.data(), nullptr);
    std::vector<Index> of_leaders(all.leaders.size());
    const auto analyse = [&] {
      std::vector<Index> order = all.order(of_leaders);
      common.common.nmethods = 1;
      common.common.method[0].ordering = CHOLMOD_GIVEN;
      Factor result = own(cholmod_analyze_p(&nodes, order.data(), nullptr, 0, common.get()));
      common.check(unknowns);
      return result;
    };
    cholmod_amd(&view, nullptr, 0, of_leaders.data(), common.get());
    common.check(unknowns);
    of_nodes = analyse();
    const double by_amd = common.common.fl;
    if (by_amd * std::pow(per_node, 3) < worth_metis * all.size()) return;
    cholmod_metis(&view, nullptr, 0, 1, of_leaders.data(), common.get());
    common.check(unknowns);
    Factor other = analyse();
    if (common.common.fl < by_amd) of_nodes = std::move(other);
  }
  /// The unknowns in the order of their nodes.
  std::vector<Index> order() const {
    std::vector<Index> ordered;
    ordered.reserve(unknowns);
    for (const Index node : std::span(static_cast<const Index*>(of_nodes->Perm), of_nodes->n))
      for (Index unknown = first[node]; unknown < first[node + 1]; ++unknown) ordered.push_back(unknown);
    return ordered;
  }

  /// The supernodal factor of the unknowns, its values to come: that of the nodes with each node's unknowns in its
  /// place.
  Factor supernodal() {
    Factor result = own(cholmod_allocate_factor(unknowns, common.get()));
    common.check(unknowns);
    const auto copy = [&](const std::vector<Index>& from) {
      auto* to =
          static_cast<Index*>(cholmod_malloc(std::max<std::size_t>(1, from.size()), sizeof(Index), common.get()));
      common.check(unknowns);
      std::ranges::copy(from, to);
      return to;
    };
    const std::vector<Index> ordered = order();
    std::ranges::copy(ordered, static_cast<Index*>(result->Perm));
    const std::span permutation(static_cast<const Index*>(of_nodes->Perm), of_nodes->n);
    std::vector<Index> start{0};  // in the factor, of each node in its order
    for (const Index node : permutation) start.push_back(start.back() + first[node + 1] - first[node]);
    const auto *node_super = static_cast<const Index*>(of_nodes->super),
               *node_pi = static_cast<const Index*>(of_nodes->pi), *node_s = static_cast<const Index*>(of_nodes->s);
    std::vector<Index> super{0}, pi{0}, px{0}, s;
    std::size_t values = 0, tallest = 0;
    operations = 0.0;
    for (std::size_t k = 0; k < of_nodes->nsuper; ++k) {
      for (Index r = node_pi[k]; r < node_pi[k + 1]; ++r)
        for (Index unknown = start[node_s[r]]; unknown < start[node_s[r] + 1]; ++unknown) s.push_back(unknown);
      super.push_back(start[node_super[k + 1]]);
      const std::size_t columns = static_cast<std::size_t>(super.back() - super[k]),
                        height = s.size() - static_cast<std::size_t>(pi.back());
      values += columns * height;
      for (std::size_t column = 0; column < columns; ++column)
        operations += std::pow(static_cast<double>(height - column), 2);
      tallest = std::max(tallest, height - columns);
      if (values > static_cast<std::size_t>(std::numeric_limits<Index>::max())) Common::refuse(unknowns);
      pi.push_back(static_cast<Index>(s.size()));
      px.push_back(static_cast<Index>(values));
    }
    result->ordering = of_nodes->ordering;
    result->is_ll = result->is_super = 1;
    result->nsuper = of_nodes->nsuper;
    result->ssize = s.size();
    result->xsize = values;
    result->maxesize = tallest;
    result->maxcsize = tallest * tallest;
    result->super = copy(super);
    result->pi = copy(pi);
    result->px = copy(px);
    result->s = copy(s);
    return result;
  }

  /// Symbolic factor.
  void prepare(const SymmetricMatrix& lower) {
    supernodes.reset();
    factor = supernodal();
    require_memory(sizeof(double) * factor_entries(), fmt::format("Cholesky factorisation: {} unknowns", unknowns),
                   "use a wider cloud spacing or a coarser mesh");
    supernodes.emplace(*factor, lower, first);
  }
  double factor_entries() const { return static_cast<double>(factor->xsize); }

  /// Whether all pivots could be divided by: all that are positive or, with signs, not zero.
  bool is_factored(const SymmetricMatrix& lower, bool with_signs) {
    if (factor->xtype == CHOLMOD_PATTERN) cholmod_change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor.get(), common.get());
    common.check(unknowns);
    signs.assign(with_signs ? unknowns : 0, 1.0);
    const Index column =
        supernodes->factorize(lower, static_cast<double*>(factor->x), with_signs ? signs.data() : nullptr);
    factor->minor = column == Supernodes::none ? factor->n : static_cast<std::size_t>(column);
    return column == Supernodes::none;
  }
  /// The unknown at which it ended.
  int ended_at() const { return static_cast<const int*>(factor->Perm)[factor->minor]; }
  void require_regular() {
    // Rounding can hide a zero pivot; what it leaves is no stiffness.
    constexpr double smallest_pivot_ratio = 1e-13;
    const double pivot_ratio = cholmod_rcond(factor.get(), common.get());
    if (pivot_ratio < smallest_pivot_ratio)
      throw NumericalError(
          fmt::format("the matrix is singular to working precision (smallest over largest pivot {:.1e})", pivot_ratio));
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
  require(node_of.empty() || (static_cast<Index>(node_of.size()) == pattern.rows() && std::ranges::is_sorted(node_of)),
          "Cholesky: a node for each unknown expected, ascending");
  impl_->analyse_nodes(node_graph(pattern, node_of));
  impl_->prepare(pattern);
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
}

void Cholesky::factorize_definite(const SymmetricMatrix& lower) {
  if (!factorize_if_definite(lower))
    throw NumericalError(
        fmt::format("the matrix is not positive definite (at unknown {} of {})", impl_->ended_at(), lower.rows()));
}

bool Cholesky::factorize_if_definite(const SymmetricMatrix& lower) {
  begin(lower);
  if (!impl_->is_factored(lower, false)) return false;
  impl_->require_regular();
  return impl_->is_current = true;
}

void Cholesky::factorize(const SymmetricMatrix& lower) {
  begin(lower);
  if (!impl_->is_factored(lower, false)) {
    if (!impl_->is_factored(lower, true))
      throw NumericalError(
          fmt::format("the matrix is singular (at unknown {} of {})", impl_->ended_at(), lower.rows()));
    impl_->negative = static_cast<Index>(std::ranges::count(impl_->signs, -1.0));
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
  if (B.cols() > 1 || !impl_->signs.empty()) {
    Matrix X = B;
    const auto& factor = *impl_->factor;
    impl_->supernodes->solve(static_cast<const double*>(factor.x), impl_->signs,
                             {static_cast<const Index*>(factor.Perm), factor.n}, X);
    return X;
  }
  Matrix X(B.rows(), B.cols());
  cholmod_dense given = dense_view(B.data(), B.rows(), B.cols(), B.outerStride()),
                found = dense_view(X.data(), X.rows(), X.cols(), X.outerStride()), *to = &found;
  Common own;  // others may solve at the same time
  std::array<cholmod_dense*, 2> space{};
  cholmod_solve2(CHOLMOD_A, impl_->factor.get(), &given, nullptr, &to, nullptr, &space[0], &space[1], own.get());
  for (cholmod_dense*& one : space) cholmod_free_dense(&one, own.get());
  own.check(impl_->unknowns);
  return X;
}

double Cholesky::factor_entries() const {
  return impl_->factor_entries();
}

double Cholesky::operations() const {
  return impl_->operations;
}

}  // namespace efree
