// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/matrix_pattern.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <limits>

namespace efree::internal {

template <int Dim> MatrixPattern<Dim>::MatrixPattern(Index n, const std::vector<const ShapeTable<Dim>*>& tables,
                                                     const SymmetricMatrix& other) {
  const Index chunk = std::max<Index>(64, (n + 15) / 16);
  struct Part {
    std::vector<Index> counts, nodes;
  };
  std::vector<Part> parts((n + chunk - 1) / chunk);
  parallel_chunks(n, chunk, [&](Index begin, Index end) {
    Part& part = parts[begin / chunk];
    std::vector<Index> seen_by(n, -1);
    for (Index a = begin; a < end; ++a) {
      const std::size_t first = part.nodes.size();
      const auto meet = [&](Index b) {
        if (b < a || seen_by[b] == a) return;
        seen_by[b] = a;
        part.nodes.push_back(b);
      };
      meet(a);
      for (const ShapeTable<Dim>* table : tables)
        for (const auto& [point, position] : table->by_node()[a]) {
          const auto nodes = table->row(point).nodes;
          for (std::size_t l = position + 1; l < nodes.size(); ++l) meet(nodes[l]);
        }
      if (other.size() > 0)
        for (int j = 0; j < Dim; ++j)
          for (SymmetricMatrix::InnerIterator entry(other, Dim * a + j); entry; ++entry) meet(entry.row() / Dim);
      std::sort(part.nodes.begin() + static_cast<std::ptrdiff_t>(first), part.nodes.end());
      part.counts.push_back(static_cast<Index>(part.nodes.size() - first));
    }
  });
  offsets_.assign(1, 0);
  for (Part& part : parts) {
    for (const Index count : part.counts) offsets_.push_back(offsets_.back() + count);
    nodes_.insert(nodes_.end(), part.nodes.begin(), part.nodes.end());
    part = {};
  }
  if (offsets_.back() * Dim * Dim > std::numeric_limits<Index>::max())
    throw InputError(fmt::format(
        "the stiffness of {} nodes has about {:.2g} entries, expected at most {:.2g}; use a "
        "wider cloud spacing or a coarser mesh",
        n, static_cast<double>(offsets_.back()) * Dim * Dim, static_cast<double>(std::numeric_limits<Index>::max())));
}

template class MatrixPattern<2>;
template class MatrixPattern<3>;

}  // namespace efree::internal
