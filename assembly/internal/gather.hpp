// SPDX-License-Identifier: GPL-3.0-or-later
/// Sparse symmetric matrices, gathered row by row.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/assembly/operators.hpp"
#include "efree/basis/shape_table.hpp"
#include "efree/core/internal/accumulator.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

namespace efree {

/// For each node, its places in ascending order of row (NodePlace::point). nodes_of(row) is the range of the row's
/// nodes.
template <class NodesOf> Ragged<NodePlace> places_of_nodes(Index nodes, Index rows, const NodesOf& nodes_of) {
  Ragged<NodePlace> places;
  places.offsets.assign(nodes + 1, 0);
  for (Index r = 0; r < rows; ++r)
    for (const Index node : nodes_of(r)) ++places.offsets[node + 1];
  std::partial_sum(places.offsets.begin(), places.offsets.end(), places.offsets.begin());
  places.items.resize(places.offsets.back());
  std::vector<Index> cursor(places.offsets.begin(), places.offsets.end() - 1);
  for (Index r = 0; r < rows; ++r) {
    Index position = 0;
    for (const Index node : nodes_of(r)) places.items[cursor[node]++] = {r, position++};
  }
  return places;
}

/// Symmetric matrix of n rows of blocks: visit(i, sums) adds block (i, j) to sums[j] for all j, the diagonal among
/// them.
template <int Dim, class Visit> BlockMatrix<Dim> gather_rows(Index n, const Visit& visit) {
  constexpr Index chunk_rows = BlockMatrix<Dim>::chunk_rows;
  BlockMatrix<Dim> result;
  result.chunks.resize((n + chunk_rows - 1) / chunk_rows);
  parallel_chunks(n, chunk_rows, [&](Index begin, Index end) {
    auto& chunk = result.chunks[begin / chunk_rows];
    Accumulator<Mat<Dim>> sums(n);
    for (Index i = begin; i < end; ++i) {
      sums.clear();
      visit(i, sums);
      for (const Index j : sums.sorted())
        if (BlockMatrix<Dim>::stores(i, j)) chunk.columns.push_back(j), chunk.blocks.push_back(sums[j]);
      chunk.close_row(i);
    }
    chunk.close();
  });
  return result;
}

/// Lower triangle of the matrix with Dim x Dim blocks for pairs of nodes: visit(a, sums) adds block (b, a) to sums[b]
/// for all b >= a it has. One thread owns one column, so the sums do not depend on the threads.
template <int Dim, class Visit> SymmetricMatrix gather_blocks(Index nodes, const Visit& visit) {
  struct Part {
    std::vector<Index> count, rows;  ///< blocks per node a; their b
    std::vector<Mat<Dim>> blocks;
  };
  const Index chunk = std::max<Index>(64, (nodes + 15) / 16);
  std::vector<Part> parts((nodes + chunk - 1) / chunk);
  parallel_chunks(nodes, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    Accumulator<Mat<Dim>> sums(nodes);
    for (Index a = begin; a < end; ++a) {
      sums.clear();
      visit(a, sums);
      const auto& touched = sums.sorted();
      part.count.push_back(static_cast<Index>(touched.size()));
      for (Index b : touched) part.rows.push_back(b), part.blocks.push_back(sums[b]);
    }
  });

  SymmetricMatrix result(Dim * nodes, Dim * nodes);
  Index* offsets = result.outerIndexPtr();
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const Index* row = parts[p].rows.data();
    Index a = static_cast<Index>(p) * chunk;
    for (const Index count : parts[p].count) {
      const int has_diagonal = count > 0 && *row == a;
      for (int j = 0; j < Dim; ++j) offsets[Dim * a + j + 1] = offsets[Dim * a + j] + Dim * count - j * has_diagonal;
      row += count;
      ++a;
    }
  }
  result.resizeNonZeros(offsets[Dim * nodes]);
  parallel_chunks(static_cast<Index>(parts.size()), 1, [&](Index p, Index) {
    const Part& part = parts[p];
    Index at = offsets[Dim * p * chunk], a = p * chunk;
    std::size_t first = 0;
    for (const Index count : part.count) {
      for (int j = 0; j < Dim; ++j)
        for (std::size_t s = first; s < first + count; ++s)
          for (int i = part.rows[s] == a ? j : 0; i < Dim; ++i, ++at) {
            result.innerIndexPtr()[at] = Dim * part.rows[s] + i;
            result.valuePtr()[at] = part.blocks[s](i, j);
          }
      first += count;
      ++a;
    }
  });
  return result;
}

}  // namespace efree
