// SPDX-License-Identifier: GPL-3.0-or-later
/// What a march keeps in its heap.
#pragma once

#include "efree/core/types.hpp"

namespace efree {

/// A vertex that a front has reached. In a heap (std::push_heap) the nearest comes first; ties by number, so that the
/// order is the same everywhere.
struct Front {
  double distance;
  Index vertex;
  friend bool operator<(const Front& a, const Front& b) {
    return a.distance != b.distance ? a.distance > b.distance : a.vertex > b.vertex;
  }
};

}  // namespace efree
