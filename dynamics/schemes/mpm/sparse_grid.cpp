// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/sparse_grid.hpp"

#include <algorithm>

namespace efree::internal {

template <int Dim> SparseGrid<Dim>::SparseGrid(std::vector<GridBlock> blocks, Index first) : first_(first) {
  std::ranges::sort(blocks, {}, &GridBlock::key);
  for (const GridBlock& block : blocks) {
    if (blocks_.empty() || blocks_.back().key != block.key)
      blocks_.push_back(block);
    else
      blocks_.back().nodes |= block.nodes;
  }
  for (GridBlock& block : blocks_) {
    block.first = first;
    first += std::popcount(block.nodes);
  }
  end_ = first;
}

template <int Dim> Index SparseGrid<Dim>::find(const Site<Dim>& site) const {
  const auto [key, bit] = locate_site<Dim>(site);
  const auto block = std::ranges::lower_bound(blocks_, key, {}, &GridBlock::key);
  const std::uint64_t mask = std::uint64_t{1} << bit;
  if (block == blocks_.end() || block->key != key || (block->nodes & mask) == 0) return -1;
  return block->first + std::popcount(block->nodes & (mask - 1));
}

template class SparseGrid<2>;
template class SparseGrid<3>;

}  // namespace efree::internal
