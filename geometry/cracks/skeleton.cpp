// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cracks/internal/skeleton.hpp"

#include <algorithm>
#include <utility>

namespace efree::internal {
namespace {

template <int Dim, std::size_t K, std::size_t Count>
SharedSimplices<K> find_shared(const Cells<Dim>& cells, const std::array<std::array<int, K>, Count>& local) {
  using Simplex = std::array<Index, K>;
  std::vector<std::pair<Simplex, std::size_t>> all;  // with their places in of_cells
  all.reserve(Count * static_cast<std::size_t>(cells.cols()));
  for (Index c = 0; c < cells.cols(); ++c)
    for (const auto& corners : local) {
      Simplex simplex;
      for (std::size_t k = 0; k < K; ++k) simplex[k] = cells(corners[k], c);
      std::ranges::sort(simplex);
      all.emplace_back(simplex, all.size());
    }
  std::ranges::sort(all);
  SharedSimplices<K> result;
  result.of_cells.resize(all.size());
  for (const auto& [simplex, place] : all) {
    if (result.vertices.empty() || result.vertices.back() != simplex) {
      result.vertices.push_back(simplex);
      result.count.push_back(0);
    }
    ++result.count.back();
    result.of_cells[place] = static_cast<Index>(result.vertices.size()) - 1;
  }
  return result;
}

}  // namespace

template <int Dim> Skeleton<Dim>::Skeleton(const Cells<Dim>& cells)
    : edges(find_shared<Dim>(cells, edges_of_cell<Dim>)) {
  if constexpr (Dim == 2)
    facets = edges;
  else
    facets = find_shared<Dim>(cells, facets_of_cell<Dim>);
}

template struct Skeleton<2>;
template struct Skeleton<3>;

}  // namespace efree::internal
