// SPDX-License-Identifier: GPL-3.0-or-later
/// The nodes of a regular grid without bounds that have material points near them.
#pragma once

#include "efree/core/types.hpp"

#include <bit>
#include <cstdint>
#include <tuple>
#include <vector>

namespace efree::internal {

/// Numbers of a node along the axes.
template <int Dim> using Site = Eigen::Vector<Index, Dim>;

/// Nodes in blocks of 64, of 8 x 8 in the plane and 4 x 4 x 4 in space.
struct GridBlock {
  std::uint64_t key;    ///< of its place; blocks are sorted by it
  std::uint64_t nodes;  ///< a bit for each node that there is
  Index first = 0;      ///< number of the first of these
  friend auto fields(GridBlock& of) { return std::tie(of.key, of.nodes, of.first); }
};

/// Key of the block of a site, and its bit there. Sites are from -2^22 to 2^22 along every axis.
template <int Dim> std::pair<std::uint64_t, int> locate_site(const Site<Dim>& site) {
  constexpr int shift = Dim == 2 ? 3 : 2;
  std::uint64_t key = 0;
  int bit = 0;
  for (int i = 0; i < Dim; ++i) {
    const std::uint32_t along = static_cast<std::uint32_t>(site[i] + (1 << 22));
    key = key << 21 | along >> shift;
    bit = bit << shift | static_cast<int>(along & ((1u << shift) - 1));
  }
  return {key, bit};
}

/// The site of a bit of a block.
template <int Dim> Site<Dim> site_of(std::uint64_t key, int bit) {
  constexpr int shift = Dim == 2 ? 3 : 2;
  Site<Dim> site;
  for (int i = Dim - 1; i >= 0; --i) {
    site[i] = static_cast<Index>((key & 0x1fffff) << shift | static_cast<std::uint64_t>(bit & ((1 << shift) - 1))) -
              (1 << 22);
    key >>= 21;
    bit >>= shift;
  }
  return site;
}

/// The nodes of one body, numbered from `first` on by blocks and bits: the same for the same nodes.
template <int Dim> class SparseGrid {
 public:
  /// Blocks in any order; those of one place become one.
  SparseGrid(std::vector<GridBlock> blocks, Index first);
  SparseGrid() = default;
  Index first() const { return first_; }
  Index end() const { return end_; }
  /// Number of the node at a site; -1: there is none.
  Index find(const Site<Dim>& site) const;
  /// Calls visit(number, site) for all nodes, ascending.
  template <class Visit> void for_each(const Visit& visit) const {
    for (const GridBlock& block : blocks_) {
      Index number = block.first;
      for (std::uint64_t rest = block.nodes; rest != 0; rest &= rest - 1)
        visit(number++, site_of<Dim>(block.key, std::countr_zero(rest)));
    }
  }
  friend auto fields(SparseGrid& of) { return std::tie(of.blocks_, of.first_, of.end_); }

 private:
  std::vector<GridBlock> blocks_;
  Index first_ = 0, end_ = 0;
};

}  // namespace efree::internal
