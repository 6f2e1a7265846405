// SPDX-License-Identifier: GPL-3.0-or-later
/// What hangs together.
#pragma once

#include "efree/core/types.hpp"

#include <boost/iterator/counting_iterator.hpp>
#include <boost/pending/disjoint_sets.hpp>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

namespace efree::internal {

/// 0, 1, ..., count - 1 in sets, at first each in one of its own.
class DisjointSets {
 public:
  explicit DisjointSets(Index count) : first_(count), rank_(count, 0) { std::iota(first_.begin(), first_.end(), 0); }

  /// Makes the sets of a and b one.
  void join(Index a, Index b) { sets().union_set(a, b); }

  /// By element: the first of its set. Joining ends here.
  std::vector<Index> firsts() && {
    const boost::counting_iterator<Index> begin(0), end(static_cast<Index>(first_.size()));
    auto all = sets();
    all.compress_sets(begin, end);
    all.normalize_sets(begin, end);
    return std::move(first_);
  }

 private:
  using Sets = boost::disjoint_sets<std::uint8_t*, Index*, boost::find_with_path_halving>;
  Sets sets() { return {rank_.data(), first_.data()}; }

  std::vector<Index> first_;        // of each set some element, until all are known
  std::vector<std::uint8_t> rank_;  // depths: at most the logarithm of the count
};

}  // namespace efree::internal
