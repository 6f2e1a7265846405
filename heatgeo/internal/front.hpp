// SPDX-License-Identifier: GPL-3.0-or-later
/// What a march keeps in its heap, and what it hands over.
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

/// A vertex that a march has reached.
struct Reached {
  Index vertex;
  double distance;
  Index origin;  ///< vertex from which the path comes straight to this one, never farther; a source is its own origin
};

}  // namespace efree
