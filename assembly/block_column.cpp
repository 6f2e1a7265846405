// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/block_column.hpp"

#include "efree/core/internal/vectors.hpp"

namespace efree::internal {
namespace {

/// The entries of a block, by columns.
template <int Dim> struct BlockLanes;
template <> struct BlockLanes<2> {
  Four all;
  EFREE_INLINE explicit BlockLanes(const double* from) { load(all, from); }
  EFREE_INLINE void add(double factor, const BlockLanes& other) { all += factor * other.all; }
  EFREE_INLINE void write(double* to) const { store(to, all); }
};
template <> struct BlockLanes<3> {
  Eight first;
  double last;
  BlockLanes() = default;
  EFREE_INLINE explicit BlockLanes(const double* from) : last(from[8]) { load(first, from); }
  EFREE_INLINE void add(double factor, const BlockLanes& other) {
    first += factor * other.first;
    last += factor * other.last;
  }
  EFREE_INLINE void write(double* to) const {
    store(to, first);
    to[8] = last;
  }
};

/// By direction J, the rows of stresses that gradients along J work on, as a block.
template <int Dim> using ByDirection = double[Dim][Dim * Dim];

template <int Dim> EFREE_INLINE void add_rows(std::span<const Index> nodes, const double* dN, const ByDirection<Dim>& S,
                                              const Index* place, double* blocks) {
  const BlockLanes<Dim> S0(S[0]), S1(S[1]), S2(S[Dim - 1]);
  for (const Index b : nodes) {
    double* const at = blocks + std::ptrdiff_t{Dim} * Dim * place[b];
    BlockLanes<Dim> sum(at);
    sum.add(dN[0], S0);
    sum.add(dN[1], S1);
    if constexpr (Dim == 3) sum.add(dN[2], S2);
    sum.write(at);
    dN += Dim;
  }
}
EFREE_FOR_EACH_MACHINE void add_rows_2(std::span<const Index> nodes, const double* dN, const ByDirection<2>& S,
                                       const Index* place, double* blocks) {
  add_rows<2>(nodes, dN, S, place, blocks);
}

/// Nine numbers, of which the last is by itself.
using Nine = BlockLanes<3>;

/// w A G, G the gradient by the displacement of the first of the nodes.
EFREE_FOR_EACH_MACHINE void add_rows_3(std::span<const Index> nodes, const double* dN, double w, const double* A,
                                       const Index* place, double* blocks) {
  ByDirection<3> S;
  for (int j = 0; j < 3; ++j) {
    Nine column{};
    for (int L = 0; L < 3; ++L) column.add(w * dN[L], Nine(A + 9 * (3 * L + j)));
    double of[9];
    column.write(of);
    for (int J = 0; J < 3; ++J)
      for (int i = 0; i < 3; ++i) S[J][i + 3 * j] = of[3 * J + i];
  }
  add_rows<3>(nodes, dN, S, place, blocks);
}

/// The same with gradients G of all nine components, 27 numbers for each node.
EFREE_FOR_EACH_MACHINE void add_products_3(std::span<const Index> nodes, const double* G, double w, const double* A,
                                           const Index* place, double* blocks) {
  double S[3][9];
  for (int j = 0; j < 3; ++j) {
    Nine column{};
    for (int q = 0; q < 9; ++q) column.add(w * G[9 * j + q], Nine(A + 9 * q));
    column.write(S[j]);
  }
  Four rows[9];  // of S: three columns, and nothing
  for (int r = 0; r < 9; ++r) rows[r] = Four{S[0][r], S[1][r], S[2][r], 0.0};
  for (const Index b : nodes) {
    double* const at = blocks + std::ptrdiff_t{9} * place[b];
    for (int i = 0; i < 3; ++i) {
      Four sum = G[9 * i] * rows[0];
      for (int r = 1; r < 9; ++r) sum += G[9 * i + r] * rows[r];
      for (int j = 0; j < 3; ++j) at[i + 3 * j] += sum[j];
    }
    G += 27;
  }
}

}  // namespace

template <int Dim>
void BlockColumn<Dim>::add(const ShapeRow<Dim>& row, std::size_t k, double w, const Tangent<Dim>& A) {
  const auto nodes = row.nodes.subspan(k);
  double* const blocks = blocks_.data()->data();
  if constexpr (Dim == 3) {
    add_rows_3(nodes, row.dN[k].data(), w, A.data(), place_.data(), blocks);
  } else {
    const GradientBlock<Dim> stress = w * nodal_gradient(row, k).stress(A);
    ByDirection<Dim> S;
    for (int J = 0; J < Dim; ++J) Eigen::Map<Mat<Dim>>{S[J]} = stress.template middleRows<Dim>(Dim * J);
    add_rows_2(nodes, row.dN[k].data(), S, place_.data(), blocks);
    if (row.hoop.empty()) return;
    for (std::size_t l = k; l < row.nodes.size(); ++l)
      (*this)[row.nodes[l]].row(0) += row.hoop[l] * stress.row(gradient_size<Dim> - 1);
  }
}

template <int Dim> void BlockColumn<Dim>::add(std::span<const Index> nodes, const GradientBlock<Dim>* gradients,
                                              double w, const Tangent<Dim>& A) {
  if constexpr (Dim == 3) {
    add_products_3(nodes, gradients->data(), w, A.data(), place_.data(), blocks_.data()->data());
  } else {
    const GradientBlock<Dim> stress = w * (A * *gradients);
    for (std::size_t l = 0; l < nodes.size(); ++l) (*this)[nodes[l]].noalias() += gradients[l].transpose() * stress;
  }
}

template class BlockColumn<2>;
template class BlockColumn<3>;

}  // namespace efree::internal
