// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/supernodes.hpp"

#include "efree/core/internal/vectors.hpp"
#include "efree/core/parallel.hpp"

#include <cblas.h>
#include <cholmod.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>

extern "C" void dpotrf_(const char* uplo, const int* n, double* A, const int* stride, int* info);

namespace efree {
namespace {

constexpr Index widest_panel = 192, tallest_tile = 384;
/// A branch has at most this share of the work.
constexpr double largest_branch = 1.0 / 64.0;
/// Operations on a panel of the trunk below which threads would only wait for each other.
constexpr double least_shared = 1e6;

}  // namespace

Index Supernodes::Panel::num_tiles() const {
  return 1 + (static_cast<Index>(rows.size()) - width + tallest_tile - 1) / tallest_tile;
}
std::pair<Index, Index> Supernodes::Panel::tile(Index t) const {
  if (t == 0) return {0, width};
  const Index begin = width + (t - 1) * tallest_tile;
  return {begin, std::min(begin + tallest_tile, static_cast<Index>(rows.size()))};
}

/// Scratch memory of a thread.
struct Supernodes::Workspace {
  std::unique_ptr<Index[]> row;  ///< of a tile, by row of the matrix
  std::unique_ptr<double[]> product;
  std::unique_ptr<double[]> turned;  ///< columns times their signs

  explicit Workspace(Index n)
      : row(std::make_unique_for_overwrite<Index[]>(static_cast<std::size_t>(n))),
        product(std::make_unique_for_overwrite<double[]>(static_cast<std::size_t>(widest_panel) * tallest_tile)),
        turned(std::make_unique_for_overwrite<double[]>(static_cast<std::size_t>(widest_panel) * widest_panel)) {}
};

/// As many as are in use at once.
class Supernodes::Workspaces {
 public:
  explicit Workspaces(Index n) : n_(n) {}

  template <class Work> void with_one(const Work& work) {
    std::unique_ptr<Workspace> space = take();
    work(*space);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(space));
  }

 private:
  std::unique_ptr<Workspace> take() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) return std::make_unique<Workspace>(n_);
    std::unique_ptr<Workspace> space = std::move(idle_.back());
    idle_.pop_back();
    return space;
  }

  Index n_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Workspace>> idle_;
};

Supernodes::Supernodes(const cholmod_factor& symbolic, const SymmetricMatrix& lower,
                       std::span<const Index> first_of_nodes)
    : rows_(static_cast<const int*>(symbolic.s), static_cast<const int*>(symbolic.s) + symbolic.ssize),
      size_(symbolic.xsize) {
  const std::vector<Index> panel_of = cut_panels(symbolic);
  list_updates(symbolic, panel_of);
  part_tree(panel_of);
  place_entries(static_cast<const int*>(symbolic.Perm), lower, first_of_nodes, panel_of);
}

std::vector<Index> Supernodes::cut_panels(const cholmod_factor& symbolic) {
  const auto* first_column = static_cast<const int*>(symbolic.super);
  const auto* first_row = static_cast<const int*>(symbolic.pi);
  const auto* first_value = static_cast<const int*>(symbolic.px);
  std::vector<Index> panel_of(symbolic.n);
  for (Index s = 0; s < static_cast<Index>(symbolic.nsuper); ++s) {
    const Index columns = first_column[s + 1] - first_column[s], height = first_row[s + 1] - first_row[s];
    const Index parts = (columns + widest_panel - 1) / widest_panel;
    for (Index part = 0; part < parts; ++part) {
      const Index begin = columns * part / parts, width = columns * (part + 1) / parts - begin;
      std::fill_n(panel_of.begin() + first_column[s] + begin, width, static_cast<Index>(panels_.size()));
      panels_.push_back({first_column[s] + begin,
                         width,
                         {rows_.data() + first_row[s] + begin, static_cast<std::size_t>(height - begin)},
                         first_value[s] + static_cast<std::size_t>(begin) * (static_cast<std::size_t>(height) + 1),
                         height});
    }
  }
  return panel_of;
}

void Supernodes::list_updates(const cholmod_factor& symbolic, const std::vector<Index>& panel_of) {
  const auto* first_column = static_cast<const int*>(symbolic.super);
  const auto* first_row = static_cast<const int*>(symbolic.pi);
  const auto* first_value = static_cast<const int*>(symbolic.px);
  const auto for_updates = [&](const auto& visit) {
    for (Index s = 0; s < static_cast<Index>(symbolic.nsuper); ++s) {
      const Index columns = first_column[s + 1] - first_column[s], height = first_row[s + 1] - first_row[s];
      const std::span rows(rows_.data() + first_row[s], static_cast<std::size_t>(height));
      for (Index begin = 0, end = 0; begin < height; begin = end) {
        const Index target = panel_of[rows[begin]];
        while (end < height && panel_of[rows[end]] == target) ++end;
        if (begin > 0)
          visit(target, Update{rows.subspan(begin), static_cast<std::size_t>(first_value[s] + begin), height,
                               first_column[s], std::min(begin, columns), end - begin});
      }
    }
  };
  updates_.offsets.assign(panels_.size() + 1, 0);
  for_updates([&](Index target, const Update&) { ++updates_.offsets[target + 1]; });
  std::partial_sum(updates_.offsets.begin(), updates_.offsets.end(), updates_.offsets.begin());
  updates_.items.resize(updates_.offsets.back());
  std::vector<Index> cursor(updates_.offsets.begin(), updates_.offsets.end() - 1);
  for_updates([&](Index target, const Update& update) { updates_.items[cursor[target]++] = update; });
}

void Supernodes::part_tree(const std::vector<Index>& panel_of) {
  const Index panels = static_cast<Index>(panels_.size());
  const auto parent = [&](const Panel& panel) {
    return static_cast<Index>(panel.rows.size()) > panel.width ? panel_of[panel.rows[panel.width]] : none;
  };
  std::vector<double> work(panels, 0.0);  // operations of every panel with all below it
  double total = 0.0;
  for (Index p = 0; p < panels; ++p) {
    double own = static_cast<double>(panels_[p].rows.size()) * panels_[p].width * panels_[p].width;
    for (const Update& u : updates_[p]) own += 2.0 * u.depth * u.num_columns * static_cast<double>(u.rows.size());
    total += own;
    work[p] += own;
    panels_[p].is_shared = own >= least_shared && panels_[p].num_tiles() > 1;
    if (const Index above = parent(panels_[p]); above != none) work[above] += work[p];
  }
  std::vector<Index> root(panels);  // of the branch that a panel belongs to
  std::vector<std::vector<Index>> branch(panels);
  for (Index p = panels - 1; p >= 0; --p) {
    const Index above = parent(panels_[p]);
    if (work[p] > largest_branch * total)
      root[p] = none;
    else
      root[p] = above == none || root[above] == none ? p : root[above];
  }
  std::vector<Index> roots;
  for (Index p = 0; p < panels; ++p) {
    if (root[p] == none)
      trunk_.push_back(p);
    else
      branch[root[p]].push_back(p);
    if (root[p] == p) roots.push_back(p);
  }
  std::ranges::stable_sort(roots, std::greater{}, [&](Index p) { return work[p]; });
  for (const Index r : roots) {
    branches_.items.insert(branches_.items.end(), branch[r].begin(), branch[r].end());
    branches_.close_row();
  }
}

void Supernodes::place_entries(const int* order, const SymmetricMatrix& lower, std::span<const Index> first_of_nodes,
                               const std::vector<Index>& panel_of) {
  const Index n = static_cast<Index>(panel_of.size());
  std::vector<Index> position(n);
  for (Index i = 0; i < n; ++i) position[order[i]] = i;
  place_.resize(static_cast<std::size_t>(lower.nonZeros()));
  const Index* const start = lower.outerIndexPtr();
  const Index* const row_of = lower.innerIndexPtr();
  std::vector<char> begins(n, 0);  // by column: whether it is the first of a node
  for (std::size_t node = 0; node + 1 < first_of_nodes.size(); ++node) begins[first_of_nodes[node]] = 1;
  // A node's unknowns lie beside each other in the factor, in columns and in rows: the places of its next column with
  // the same rows are those of the one before, shifted.
  const auto is_shifted = [&](Index column) {
    const Index before = column - 1, count = start[column + 1] - start[column];
    return !begins[column] && panel_of[position[column]] == panel_of[position[before]] &&
           start[column] - start[before] == count + 1 &&
           std::equal(row_of + start[column], row_of + start[column + 1], row_of + start[before] + 1);
  };
  parallel_chunks(n, 256, [&](Index begin, Index end) {
    for (Index column = begin; column < end; ++column) {
      if (column > begin && is_shifted(column)) {
        const Index* const before = place_.data() + start[column - 1] + 1;
        const Index c = position[column], to_next_column = panels_[panel_of[c]].stride;
        for (Index k = start[column]; k < start[column + 1]; ++k)
          place_[k] = before[k - start[column]] + (position[row_of[k]] >= c ? to_next_column : 1);
        continue;
      }
      Index known = none, row = none;  // the last panel, its row, and where that is
      std::size_t found = 0;
      for (Index k = start[column]; k < start[column + 1]; ++k) {
        const auto [c, r] = std::minmax({position[column], position[row_of[k]]});
        const Panel& panel = panels_[panel_of[c]];
        if (known == panel_of[c] && r == row + 1 && found + 1 < panel.rows.size() && panel.rows[found + 1] == r)
          ++found;
        else if (known != panel_of[c] || r != row)
          found = static_cast<std::size_t>(std::ranges::lower_bound(panel.rows, r) - panel.rows.begin());
        known = panel_of[c];
        row = r;
        place_[k] =
            panel.values + found + static_cast<std::size_t>(c - panel.first) * static_cast<std::size_t>(panel.stride);
      }
    }
  });
}

void Supernodes::update(const Panel& panel, Index t, std::span<const Update> updates, Workspace& space,
                        const Factor& to) const {
  double* const L = to.L;
  const auto [top, bottom] = panel.tile(t);
  for (Index r = top; r < bottom; ++r) space.row[panel.rows[r]] = r;
  for (const Update& u : updates) {
    const auto begin = std::ranges::lower_bound(u.rows, panel.rows[top]);
    const auto end = std::upper_bound(begin, u.rows.end(), panel.rows[bottom - 1]);
    if (begin == end) continue;
    const Index height = static_cast<Index>(end - begin), width = u.num_columns;
    const double* upper = L + u.values;
    const double* left = upper + (begin - u.rows.begin());
    const auto column = [&](Index j) {
      return L + panel.values +
             static_cast<std::size_t>(u.rows[j] - panel.first) * static_cast<std::size_t>(panel.stride);
    };
    const auto multiply = [&](double sign, double keep, double* C, Index stride) {
      if (to.signs) {
        for (Index d = 0, count; d < u.depth; d += count, keep = 1.0) {
          count = std::min(widest_panel, u.depth - d);
          for (Index k = 0; k < count; ++k)
            for (Index j = 0; j < width; ++j)
              space.turned[j + k * width] = to.signs[u.first + d + k] * upper[j + std::ptrdiff_t{d + k} * u.stride];
          cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, height, width, count, sign,
                      left + std::ptrdiff_t{d} * u.stride, u.stride, space.turned.get(), width, keep, C, stride);
        }
        return;
      }
      if (t == 0)
        cblas_dsyrk(CblasColMajor, CblasLower, CblasNoTrans, height, u.depth, sign, left, u.stride, keep, C, stride);
      else
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasTrans, height, width, u.depth, sign, left, u.stride, upper,
                    u.stride, keep, C, stride);
    };
    const Index first = space.row[*begin];
    const bool is_block = space.row[*(end - 1)] - first == height - 1 && u.rows[width - 1] - u.rows[0] == width - 1;
    if (is_block) {
      multiply(-1.0, 1.0, column(0) + first, panel.stride);
      continue;
    }
    multiply(1.0, 0.0, space.product.get(), height);
    for (Index j = 0; j < width; ++j) {
      double* target = column(j);
      const double* product = space.product.get() + static_cast<std::size_t>(j) * static_cast<std::size_t>(height);
      for (Index i = t == 0 ? j : 0; i < height; ++i) target[space.row[begin[i]]] -= product[i];
    }
  }
}

namespace {

/// Cholesky factor of a small matrix, in its place. Returns the column where it ends, or `none`.
Index factorize_square(Index size, double* A, Index stride) {
  int info = 0;
  dpotrf_("L", &size, A, &stride, &info);
  return info > 0 ? info - 1 : Supernodes::none;
}
/// The same with signs.
Index factorize_square(Index size, double* A, Index stride, double* signs) {
  const auto column = [&](Index j) { return A + std::ptrdiff_t{j} * stride; };
  for (Index j = 0; j < size; ++j) {
    double* const L = column(j);
    const double pivot = L[j];
    if (pivot == 0.0 || !std::isfinite(pivot)) return j;
    signs[j] = pivot > 0.0 ? 1.0 : -1.0;
    L[j] = std::sqrt(std::abs(pivot));
    for (Index i = j + 1; i < size; ++i) L[i] /= signs[j] * L[j];
    for (Index k = j + 1; k < size; ++k) {
      const double share = signs[j] * L[k];
      double* const other = column(k);
      for (Index i = k; i < size; ++i) other[i] -= share * L[i];
    }
  }
  return Supernodes::none;
}
/// B <- B A^-T for a lower triangle A, and times the signs, if there are any.
void divide(Index rows, Index columns, const double* A, double* B, Index stride, const double* signs) {
  cblas_dtrsm(CblasColMajor, CblasRight, CblasLower, CblasTrans, CblasNonUnit, rows, columns, 1.0, A, stride, B,
              stride);
  for (Index j = 0; signs && j < columns; ++j)
    if (signs[j] < 0.0)
      for (Index i = 0; i < rows; ++i) B[i + std::ptrdiff_t{j} * stride] *= -1.0;
}

}  // namespace

/// The square of a panel. Returns the column of the factor where it ends, or `none`.
Index Supernodes::factorize_first(const Panel& panel, const Factor& to) const {
  double* const square = to.L + panel.values;
  const Index column = to.signs ? factorize_square(panel.width, square, panel.stride, to.signs + panel.first)
                                : factorize_square(panel.width, square, panel.stride);
  return column == none ? none : panel.first + column;
}
/// A tile below it.
void Supernodes::divide_tile(const Panel& panel, Index t, const Factor& to) const {
  double* const square = to.L + panel.values;
  const auto [top, bottom] = panel.tile(t);
  divide(bottom - top, panel.width, square, square + top, panel.stride, to.signs ? to.signs + panel.first : nullptr);
}

Index Supernodes::factorize_alone(Index p, Workspace& space, const Factor& to) const {
  const Panel& panel = panels_[p];
  update(panel, 0, updates_[p], space, to);
  if (const Index column = factorize_first(panel, to); column != none) return column;
  for (Index t = 1; t < panel.num_tiles(); ++t) {
    update(panel, t, updates_[p], space, to);
    divide_tile(panel, t, to);
  }
  return none;
}

Index Supernodes::factorize_together(Index p, Workspaces& spaces, const Factor& to) const {
  const Panel& panel = panels_[p];
  parallel_chunks(panel.num_tiles(), 1, [&](Index t, Index) {
    spaces.with_one([&](Workspace& space) { update(panel, t, updates_[p], space, to); });
  });
  if (const Index column = factorize_first(panel, to); column != none) return column;
  parallel_chunks(panel.num_tiles() - 1, 1, [&](Index t, Index) { divide_tile(panel, t + 1, to); });
  return none;
}

Index Supernodes::factorize_branch(std::span<const Index> branch, Workspaces& spaces, const Factor& to) const {
  Index failed = none;
  spaces.with_one([&](Workspace& space) {
    for (std::size_t k = 0; k < branch.size() && failed == none; ++k) failed = factorize_alone(branch[k], space, to);
  });
  return failed;
}

Index Supernodes::factorize_trunk(Workspaces& spaces, const Factor& to) const {
  Index failed = none;
  for (std::size_t k = 0; k < trunk_.size() && failed == none; ++k) {
    const Index p = trunk_[k];
    if (panels_[p].is_shared)
      failed = factorize_together(p, spaces, to);
    else
      spaces.with_one([&](Workspace& space) { failed = factorize_alone(p, space, to); });
  }
  return failed;
}

Index Supernodes::factorize(const SymmetricMatrix& lower, double* L, double* signs) const {
  if (panels_.empty()) return none;
  const Factor to{L, signs};
  constexpr std::size_t piece = std::size_t{1} << 18;
  parallel_chunks(static_cast<Index>((size_ + piece - 1) / piece), 1, [&](Index k, Index) {
    std::fill(L + static_cast<std::size_t>(k) * piece, L + std::min(size_, static_cast<std::size_t>(k + 1) * piece),
              0.0);
  });
  parallel_chunks(lower.nonZeros(), 1 << 16, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) L[place_[k]] = lower.valuePtr()[k];
  });
  Workspaces spaces(panels_.back().first + panels_.back().width);
  std::vector<Index> ended(branches_.rows(), none);
  parallel_chunks(branches_.rows(), 1, [&](Index b, Index) { ended[b] = factorize_branch(branches_[b], spaces, to); });
  const Index first = std::ranges::min(ended.empty() ? std::vector{none} : ended);
  return first != none ? first : factorize_trunk(spaces, to);
}

namespace {

/// Sixteen numbers; a vector of as many would go by way of memory.
struct Sixteen {
  internal::Eight a, b;
  EFREE_INLINE Sixteen& operator+=(const Sixteen& other) { return a += other.a, b += other.b, *this; }
  EFREE_INLINE Sixteen& operator-=(const Sixteen& other) { return a -= other.a, b -= other.b, *this; }
  EFREE_INLINE Sixteen& operator/=(double by) { return a /= by, b /= by, *this; }
  EFREE_INLINE friend Sixteen operator+(Sixteen one, const Sixteen& other) { return one += other; }
  EFREE_INLINE friend Sixteen operator-(Sixteen one, const Sixteen& other) { return one -= other; }
  EFREE_INLINE friend Sixteen operator*(double by, const Sixteen& of) { return {by * of.a, by * of.b}; }
};
using internal::load;
using internal::store;
EFREE_INLINE void load(Sixteen& to, const double* from) {
  load(to.a, from);
  load(to.b, from + 8);
}
EFREE_INLINE void store(double* to, const Sixteen& from) {
  store(to, from.a);
  store(to + 8, from.b);
}

/// Columns of a factor, the first of which has its diagonal in the first row; four of them are taken at once.
struct Columns {
  const double* L;
  Index width, height, stride;
  const Index* rows;

  /// The k-th of four columns from j on; where there are fewer, the last again.
  const double* column(Index j, Index k) const {
    return L + static_cast<std::ptrdiff_t>(std::min(j + k, width - 1)) * stride;
  }
};

/// x of the columns, and off the rows below what these make of it. V: as many numbers as there are for each row.
template <class V> EFREE_INLINE void forward(const Columns& of, double* x) {
  constexpr std::ptrdiff_t size = sizeof(V) / sizeof(double);
  for (Index j = 0; j < of.width; j += 4) {
    const Index count = std::min<Index>(4, of.width - j);
    const double* L[4];
    V y[4] = {};
    for (Index k = 0; k < 4; ++k) L[k] = of.column(j, k);
    for (Index k = 0; k < count; ++k) {
      double* at = x + size * of.rows[j + k];
      load(y[k], at);
      for (Index l = 0; l < k; ++l) y[k] -= L[l][j + k] * y[l];
      y[k] /= L[k][j + k];
      store(at, y[k]);
    }
    for (Index i = j + count; i < of.height; ++i) {
      double* at = x + size * of.rows[i];
      V z;
      load(z, at);
      z -= (L[0][i] * y[0] + L[1][i] * y[1]) + (L[2][i] * y[2] + L[3][i] * y[3]);
      store(at, z);
    }
  }
}

/// The same with the transpose: x of the columns, of that of the rows below.
template <class V> EFREE_INLINE void backward(const Columns& of, double* x) {
  constexpr std::ptrdiff_t size = sizeof(V) / sizeof(double);
  for (Index j = (of.width - 1) / 4 * 4; j >= 0; j -= 4) {
    const Index count = std::min<Index>(4, of.width - j);
    const double* L[4];
    V sum[4] = {};
    for (Index k = 0; k < 4; ++k) L[k] = of.column(j, k);
    for (Index i = j + count; i < of.height; ++i) {
      V z;
      load(z, x + size * of.rows[i]);
      for (Index k = 0; k < 4; ++k) sum[k] += L[k][i] * z;
    }
    for (Index k = count - 1; k >= 0; --k) {
      double* at = x + size * of.rows[j + k];
      V y;
      load(y, at);
      y -= sum[k];
      y /= L[k][j + k];
      store(at, y);
      for (Index l = 0; l < k; ++l) sum[l] += L[l][j + k] * y;
    }
  }
}

template <class V> EFREE_INLINE void solve(std::span<const Columns> all, std::span<const double> signs, double* x) {
  constexpr std::ptrdiff_t size = sizeof(V) / sizeof(double);
  for (const Columns& of : all) forward<V>(of, x);
  for (std::size_t i = 0; i < signs.size(); ++i)
    if (signs[i] < 0.0)
      for (std::ptrdiff_t k = 0; k < size; ++k) x[size * static_cast<std::ptrdiff_t>(i) + k] *= -1.0;
  for (std::size_t k = all.size(); k-- > 0;) backward<V>(all[k], x);
}
EFREE_FOR_EACH_MACHINE void solve_4(std::span<const Columns> all, std::span<const double> signs, double* x) {
  solve<internal::Four>(all, signs, x);
}
EFREE_FOR_EACH_MACHINE void solve_8(std::span<const Columns> all, std::span<const double> signs, double* x) {
  solve<internal::Eight>(all, signs, x);
}
EFREE_FOR_EACH_MACHINE void solve_16(std::span<const Columns> all, std::span<const double> signs, double* x) {
  solve<Sixteen>(all, signs, x);
}

}  // namespace

void Supernodes::solve(const double* L, std::span<const double> signs, std::span<const Index> order,
                       Eigen::Ref<Matrix> B) const {
  std::vector<Columns> all;
  for (const Panel& panel : panels_)
    all.push_back(
        {L + panel.values, panel.width, static_cast<Index>(panel.rows.size()), panel.stride, panel.rows.data()});
  std::vector<double> x;
  for (Index begin = 0, count; begin < B.cols(); begin += count) {
    count = std::min<Index>(16, static_cast<Index>(B.cols()) - begin);
    const std::size_t size = count <= 4 ? 4 : count <= 8 ? 8 : 16;
    x.assign(size * order.size(), 0.0);
    // Piece by piece, so that what is written to in turn stays near.
    const auto for_each = [&](const auto& visit) {
      constexpr std::size_t piece = 256;
      for (std::size_t first = 0; first < order.size(); first += piece)
        for (Index k = 0; k < count; ++k)
          for (std::size_t i = first; i < std::min(first + piece, order.size()); ++i)
            visit(x[size * i + static_cast<std::size_t>(k)], B(order[i], begin + k));
    };
    for_each([](double& to, double from) { to = from; });
    (size == 4 ? solve_4 : size == 8 ? solve_8 : solve_16)(all, signs, x.data());
    for_each([](double from, double& to) { to = from; });
  }
}

}  // namespace efree
