// SPDX-License-Identifier: GPL-3.0-or-later
/// A sparse symmetric matrix whose pattern is set up once, and into which any number of terms are summed in place.
#pragma once

#include "efree/assembly/internal/block_column.hpp"
#include "efree/assembly/internal/unknowns.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <span>
#include <vector>

namespace efree::internal {

/// Adds sum_K w_K G_b^T A_K G_a, K the points of a discretization, to the blocks of the column of node a.
template <int Dim, class Tangents>
void add_stiffness(const Discretization<Dim>& discretization, const Tangents& A, Index a, BlockColumn<Dim>& column) {
  for (const auto& [K, k] : discretization.shape.by_node()[a]) {
    const auto row = discretization.shape.row(K);
    column.add(row, k, discretization.weights[K], A[K]);
  }
}

/// Lower triangle of a matrix of unknowns whose blocks are those of pairs of nodes that meet at a point of some table.
template <int Dim> class MatrixPattern {
 public:
  /// Nodes meet in the rows of the tables and in the entries of `other`, a lower triangle of all degrees of freedom.
  /// Throws InputError for more entries than SymmetricMatrix can number.
  MatrixPattern(Index nodes, const std::vector<const ShapeTable<Dim>*>& tables, const SymmetricMatrix& other);

  /// A matrix of the unknowns with this pattern, its values not set.
  SymmetricMatrix layout(const Unknowns<Dim>& unknowns) const;

  /// Makes K the sum of what visit(a, column) adds to the blocks of the column of each node a, and `other`, on the
  /// unknowns. K is empty, or was made with the same unknowns: then only its values are written. One thread owns one
  /// column, so the sums do not depend on the threads.
  template <class Visit>
  void sum(const Unknowns<Dim>& unknowns, const Visit& visit, const SymmetricMatrix& other, SymmetricMatrix& K) const;

 private:
  std::span<const Index> column(Index a) const {
    return {nodes_.data() + offsets_[a], nodes_.data() + offsets_[a + 1]};
  }
  /// Visits the entries of a node's columns in the order they are stored: visit(k, i, j) for component (i, j) of the
  /// k-th block.
  template <class Visit> void for_each_entry(const Unknowns<Dim>& unknowns, Index a, const Visit& visit) const {
    const auto nodes = column(a);
    for (int j = 0; j < Dim; ++j) {
      if (unknowns(a, j) < 0) continue;
      for (std::size_t k = 0; k < nodes.size(); ++k)
        for (int i = nodes[k] == a ? j : 0; i < Dim; ++i)
          if (unknowns(nodes[k], i) >= 0) visit(k, i, j);
    }
  }

  std::vector<Offset> offsets_;  ///< by node
  std::vector<Index> nodes_;     ///< that it meets, itself and those after it, ascending
};

template <int Dim> SymmetricMatrix MatrixPattern<Dim>::layout(const Unknowns<Dim>& unknowns) const {
  const Index n = unknowns.num_nodes();
  SymmetricMatrix K(unknowns.size(), unknowns.size());
  std::vector<Index> first(n + 1, 0);
  parallel_for(n, [&](Index a) { for_each_entry(unknowns, a, [&](std::size_t, int, int) { ++first[a + 1]; }); });
  for (Index a = 0; a < n; ++a) first[a + 1] += first[a];
  K.resizeNonZeros(first[n]);
  parallel_for(n, [&](Index a) {
    Index at = first[a];
    int before = -1;
    for_each_entry(unknowns, a, [&](std::size_t k, int i, int j) {
      if (j != before) K.outerIndexPtr()[unknowns(a, j)] = at, before = j;
      K.innerIndexPtr()[at++] = unknowns(column(a)[k], i);
    });
  });
  K.outerIndexPtr()[K.cols()] = first[n];
  return K;
}

template <int Dim> template <class Visit> void MatrixPattern<Dim>::sum(const Unknowns<Dim>& unknowns,
                                                                       const Visit& visit, const SymmetricMatrix& other,
                                                                       SymmetricMatrix& K) const {
  const Index n = unknowns.num_nodes();
  const auto& node_of = unknowns.node_of();
  if (K.size() == 0) K = layout(unknowns);
  const Index chunk = std::max<Index>(64, (n + 15) / 16);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    BlockColumn<Dim> sums(n);
    Index c = static_cast<Index>(std::ranges::lower_bound(node_of, begin) - node_of.begin());
    for (Index a = begin; a < end; ++a) {
      const auto nodes = column(a);
      sums.begin(nodes);
      visit(a, sums);
      if (other.size() > 0)
        for (int j = 0; j < Dim; ++j)
          for (SymmetricMatrix::InnerIterator entry(other, Dim * a + j); entry; ++entry)
            sums[entry.row() / Dim](entry.row() % Dim, j) += entry.value();
      Mat<Dim>& diagonal = sums.at_place(0);
      diagonal.template triangularView<Eigen::StrictlyUpper>() = diagonal.transpose();
      const Mat<Dim>* turn = unknowns.frame(a);
      for (std::size_t k = 0; k < nodes.size(); ++k) {
        if (turn) sums.at_place(k) = sums.at_place(k) * *turn;
        if (const Mat<Dim>* other_turn = unknowns.frame(nodes[k]))
          sums.at_place(k) = other_turn->transpose() * sums.at_place(k);
      }
      if (c == static_cast<Index>(node_of.size()) || node_of[c] != a) continue;  // all of its components are fixed
      double* value = K.valuePtr() + K.outerIndexPtr()[c];
      for_each_entry(unknowns, a, [&](std::size_t k, int i, int j) { *value++ = sums.at_place(k)(i, j); });
      while (c < static_cast<Index>(node_of.size()) && node_of[c] == a) ++c;
    }
  });
}

}  // namespace efree::internal
