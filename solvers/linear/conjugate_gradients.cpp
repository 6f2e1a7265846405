// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/solvers/linear/internal/conjugate_gradients.hpp"

#include "efree/core/internal/vectors.hpp"
#include "efree/core/parallel.hpp"

#include <cblas.h>

#include <algorithm>
#include <cmath>
#include <utility>

extern "C" {
void spotrf_(const char* uplo, const int* n, float* A, const int* stride, int* info);
void spotri_(const char* uplo, const int* n, float* A, const int* stride, int* info);
}

namespace efree {
namespace {

/// Nodes of a cluster (docs/evidence.md, "Tangents without a factor").
constexpr Index cluster_size = 100;
constexpr Index lanes = 16;
/// Nodes whose rows share what they gather.
constexpr Index nodes_at_once = 4;
/// Of a product, each with a sum of its own.
constexpr Index most_parts = 8;
using Lanes = float __attribute__((vector_size(4 * lanes)));

/// Of the upper triangle, rows of which the first columns are their own: y += rows x there, and with the transpose, of
/// all columns but these. `count` columns, a multiple of lanes, are gathered once.
EFREE_FOR_EACH_MACHINE void multiply_rows(const Index* columns, Index count, const float* values, Index width,
                                          Index first, const float* x, float* gathered, float* y) {
  float* const sums = gathered + count;
  for (Index k = 0; k < count; ++k) gathered[k] = x[columns[k]];
  for (Index k = 0; k < count; ++k) sums[k] = 0.0f;
  for (Index row = 0; row < width; ++row, values += count) {
    Lanes sum{};
    const float here = x[first + row];
    for (Index k = 0; k < count; k += lanes) {
      Lanes a, b, c;
      std::memcpy(&a, values + k, sizeof a);
      std::memcpy(&b, gathered + k, sizeof b);
      std::memcpy(&c, sums + k, sizeof c);
      sum += a * b;
      c += a * here;
      std::memcpy(sums + k, &c, sizeof c);
    }
    for (Index half = lanes / 2; half > 0; half /= 2)
      for (Index i = 0; i < half; ++i) sum[i] += sum[i + half];
    y[first + row] += sum[0];
  }
  for (Index k = width; k < count; ++k) y[columns[k]] += sums[k];
}

/// Sums in an order that does not depend on threads.
double dot(const Vector& a, const Vector& b) {
  constexpr Index chunk = 1 << 14;
  const Index n = static_cast<Index>(a.size());
  if (n <= chunk) return a.dot(b);
  std::vector<double> sums((n + chunk - 1) / chunk);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    sums[begin / chunk] = a.segment(begin, end - begin).dot(b.segment(begin, end - begin));
  });
  double sum = 0.0;
  for (const double one : sums) sum += one;
  return sum;
}

}  // namespace

ConjugateGradients::ConjugateGradients(NodeGraph graph) : graph_(std::move(graph)) {
  const Index n = graph_.first.back(), nodes = graph_.size();
  order_.reserve(n);
  place_.resize(n);
  rows_of_.resize(nodes);
  std::vector<Index> rank(nodes);  // of the nodes, by cluster
  std::vector<Index> sorted;       // by rank
  for (const auto& cluster : clusters(graph_, cluster_size)) {
    const Index begin = static_cast<Index>(order_.size());
    for (std::size_t k = 0; k < cluster.size(); ++k) {
      const Index node = cluster[k];
      if (k % nodes_at_once == 0) rows_.push_back({static_cast<Index>(order_.size()), 0, 0, 0, 0});
      rows_.back().width += graph_.first[node + 1] - graph_.first[node];
      rows_of_[node] = static_cast<Index>(rows_.size()) - 1;
      rank[node] = static_cast<Index>(sorted.size());
      sorted.push_back(node);
      for (Index unknown = graph_.first[node]; unknown < graph_.first[node + 1]; ++unknown) {
        place_[unknown] = static_cast<Index>(order_.size());
        order_.push_back(unknown);
      }
    }
    clusters_.push_back({begin, static_cast<Index>(order_.size()) - begin, {}});
  }
  std::vector<std::vector<Index>> beyond(rows_.size());  // by rows: ranks of other nodes
  for (Index a = 0; a < nodes; ++a)
    for (Index k = graph_.offsets[a]; k < graph_.offsets[a + 1]; ++k) {
      const auto [i, j] = std::minmax(rank[a], rank[graph_.rows[k]]);
      if (const Index rows = rows_of_[sorted[i]]; rows != rows_of_[sorted[j]]) beyond[rows].push_back(j);
    }
  std::vector<std::vector<Index>> start(rows_.size());  // the first column of each of these
  std::size_t values = 0;
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    Rows& rows = rows_[k];
    std::ranges::sort(beyond[k]);
    beyond[k].erase(std::unique(beyond[k].begin(), beyond[k].end()), beyond[k].end());
    rows.columns = static_cast<Index>(columns_.size());
    for (Index c = 0; c < rows.width; ++c) columns_.push_back(rows.first + c);
    for (const Index j : beyond[k]) {
      start[k].push_back(static_cast<Index>(columns_.size()) - rows.columns);
      for (Index unknown = graph_.first[sorted[j]]; unknown < graph_.first[sorted[j] + 1]; ++unknown)
        columns_.push_back(place_[unknown]);
    }
    while (columns_.size() % lanes != 0) columns_.push_back(0);
    rows.stride = static_cast<Index>(columns_.size()) - rows.columns;
    rows.values = values;
    values += static_cast<std::size_t>(rows.stride) * static_cast<std::size_t>(rows.width);
  }
  values_.resize(values);
  for (Index a = 0; a < nodes; ++a)
    for (Index k = graph_.offsets[a]; k < graph_.offsets[a + 1]; ++k) {
      const auto [i, j] = std::minmax(rank[a], rank[graph_.rows[k]]);
      const Index at = rows_of_[sorted[i]], first = place_[graph_.first[sorted[i]]];
      const Rows& rows = rows_[at];
      const Index column = at == rows_of_[sorted[j]]
                               ? place_[graph_.first[sorted[j]]] - rows.first
                               : start[at][std::ranges::lower_bound(beyond[at], j) - beyond[at].begin()];
      blocks_.push_back(rows.values +
                        static_cast<std::size_t>(first - rows.first) * static_cast<std::size_t>(rows.stride) +
                        static_cast<std::size_t>(column));
    }
}

double ConjugateGradients::numbers(const NodeGraph& graph, double entries) {
  const double unknowns = graph.first.back(), per_node = unknowns / std::max<Index>(1, graph.size());
  return entries + unknowns * per_node * cluster_size;
}

bool ConjugateGradients::take(const SymmetricMatrix& lower) {
  scale_ = 1.0 / lower.coeffs().cwiseAbs().maxCoeff();
  parallel_chunks(graph_.size(), 64, [&](Index begin, Index end) {
    for (Index a = begin; a < end; ++a) {
      for (Index c = 0; c < graph_.first[a + 1] - graph_.first[a]; ++c) {
        const double* value = lower.valuePtr() + lower.outerIndexPtr()[graph_.first[a] + c];
        for (Index k = graph_.offsets[a]; k < graph_.offsets[a + 1]; ++k) {
          const Index b = graph_.rows[k], width = graph_.first[b + 1] - graph_.first[b];
          const bool below = place_[graph_.first[b]] >= place_[graph_.first[a]];  // its mirror image is above
          const std::ptrdiff_t stride = rows_[below ? rows_of_[a] : rows_of_[b]].stride;
          const std::ptrdiff_t by_row = below ? 1 : stride, by_column = below ? stride : 1;
          float* const block = values_.data() + blocks_[k];
          for (Index r = b == a ? c : 0; r < width; ++r)
            block[r * by_row + c * by_column] = static_cast<float>(scale_ * *value++);
        }
      }
    }
  });
  // Within rows, what is below the diagonal.
  parallel_for(static_cast<Index>(rows_.size()), [&](Index k) {
    Eigen::Map<Eigen::MatrixXf, 0, Eigen::OuterStride<>> own(values_.data() + rows_[k].values, rows_[k].width,
                                                             rows_[k].width, Eigen::OuterStride<>(rows_[k].stride));
    own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
  });
  std::vector<char> definite(clusters_.size());
  parallel_chunks(static_cast<Index>(clusters_.size()), 1, [&](Index k, Index) {
    Cluster& cluster = clusters_[k];
    int size = cluster.size, info = 0;
    Eigen::MatrixXf& block = cluster.inverse;
    block.setZero(size, size);
    for (Index j = 0; j < size; ++j)
      for (SymmetricMatrix::InnerIterator entry(lower, order_[cluster.first + j]); entry; ++entry)
        if (const Index i = place_[entry.row()] - cluster.first; i >= 0 && i < size)
          block(std::max(i, j), std::min(i, j)) = static_cast<float>(scale_ * entry.value());
    spotrf_("L", &size, block.data(), &size, &info);
    if (info == 0) spotri_("L", &size, block.data(), &size, &info);
    definite[k] = info == 0;
    block.triangularView<Eigen::StrictlyUpper>() = block.transpose();
  });
  return std::ranges::all_of(definite, [](char one) { return one != 0; });
}

void ConjugateGradients::multiply(const Floats& x, Vector& y) const {
  const Index n = static_cast<Index>(x.size()), count = static_cast<Index>(rows_.size());
  const Index chunk = std::max<Index>(16, (count + most_parts - 1) / most_parts);
  std::vector<Floats> parts((count + chunk - 1) / chunk);
  parallel_chunks(count, chunk, [&](Index begin, Index end) {
    Floats& part = parts[begin / chunk];
    part = Floats::Zero(n);
    std::vector<float> room;
    for (Index k = begin; k < end; ++k) {
      const Rows& rows = rows_[k];
      room.resize(std::max(room.size(), std::size_t{2} * static_cast<std::size_t>(rows.stride)));
      multiply_rows(columns_.data() + rows.columns, rows.stride, values_.data() + rows.values, rows.width, rows.first,
                    x.data(), room.data(), part.data());
    }
  });
  parallel_chunks(n, 4096, [&](Index begin, Index end) {
    auto to = y.segment(begin, end - begin);
    to = parts.front().segment(begin, end - begin).cast<double>();
    for (std::size_t k = 1; k < parts.size(); ++k) to += parts[k].segment(begin, end - begin).cast<double>();
  });
}

void ConjugateGradients::precondition(const Vector& r, Vector& z) const {
  parallel_chunks(static_cast<Index>(clusters_.size()), 1, [&](Index k, Index) {
    const auto& [first, size, inverse] = clusters_[k];
    const Floats here = r.segment(first, size).cast<float>();
    Floats there(size);
    cblas_sgemv(CblasColMajor, CblasTrans, size, size, 1.0f, inverse.data(), size, here.data(), 1, 0.0f, there.data(),
                1);
    z.segment(first, size) = there.cast<double>();
  });
}

/// What conjugate gradients come to.
struct ConjugateGradients::Descent {
  Vector x;
  int products = 0;
  bool ended = true;  ///< at the goal
};

ConjugateGradients::Descent ConjugateGradients::descend(const Vector& forces, double tolerance, int most) const {
  constexpr int probation = 25;  // after as many, and as many again, it is asked whether it will take too long
  const auto n = forces.size();
  Descent now{.x = Vector::Zero(n)};
  Vector r = forces, z(n), p(n), q(n);
  const double whole = std::sqrt(dot(forces, forces));
  double rz = 0.0;
  for (double left = 1.0; left > tolerance; left = std::sqrt(dot(r, r)) / whole) {
    const bool hopeless = now.products > 0 && now.products % probation == 0 &&
                          now.products * std::log(tolerance) < most * std::log(std::min(left, 0.99));
    if (hopeless || now.products == most) {
      now.ended = false;
      break;
    }
    precondition(r, z);
    const double next = dot(r, z);
    if (now.products == 0)
      p = z;
    else
      p = z + next / rz * p;
    rz = next;
    multiply(p.cast<float>(), q);
    ++now.products;
    const double curvature = dot(p, q);
    if (!(curvature > 0.0)) {
      now.ended = false;
      break;
    }
    now.x += rz / curvature * p;
    r -= rz / curvature * q;
  }
  return now;
}

std::optional<Vector> ConjugateGradients::solve(const SymmetricMatrix& A, const Vector& b, double tolerance,
                                                int most) const {
  constexpr double at_once = 1e-5;  // as much as single precision bears
  const double size = b.cwiseAbs().maxCoeff();
  if (!b.allFinite()) return std::nullopt;
  if (size == 0.0) return Vector::Zero(b.size());
  const Vector unit = b / size;
  const double goal = tolerance * unit.norm();
  Vector x = Vector::Zero(b.size()), r = unit;
  for (double left = unit.norm(), before; left > goal;) {
    const Descent change = descend(r(order_), std::max(at_once, 0.5 * goal / left), most);
    most -= change.products;
    if (!change.ended) return std::nullopt;
    x(order_) += scale_ * change.x;
    r = unit - A.selfadjointView<Eigen::Lower>() * x;
    before = std::exchange(left, r.norm());
    if (left > goal && !(left < 0.5 * before)) return std::nullopt;
  }
  return size * x;
}

}  // namespace efree
