// SPDX-License-Identifier: GPL-3.0-or-later
/// Sums into few of many slots.
#pragma once

#include "efree/core/types.hpp"

#include <algorithm>
#include <vector>

namespace efree {

/// Sums contributions to few of many slots; remembers which, so that clearing costs only those.
template <class Value> class Accumulator {
 public:
  explicit Accumulator(Index size) : stamp_(size, -1), values_(size) {}
  void clear() {
    ++current_;
    touched_.clear();
  }
  Value& operator[](Index i) {
    if (stamp_[i] != current_) {
      stamp_[i] = current_;
      values_[i] = Value::Zero();
      touched_.push_back(i);
    }
    return values_[i];
  }
  Index size() const { return static_cast<Index>(values_.size()); }
  /// Touched slots in ascending order.
  const std::vector<Index>& sorted() {
    std::sort(touched_.begin(), touched_.end());
    return touched_;
  }
  const std::vector<Index>& touched() const { return touched_; }

 private:
  std::vector<Index> stamp_;
  std::vector<Value, Eigen::aligned_allocator<Value>> values_;
  std::vector<Index> touched_;
  Index current_ = -1;
};

}  // namespace efree
