// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies inside each other.
#pragma once

#include "efree/core/types.hpp"

namespace efree {

/// A node inside another body.
struct Overlap {
  Index node = -1, body = -1;  ///< the node, and the body that it is inside of; -1: there is none
  double depth = 0.0;          ///< distance of the node from the facet that it faces [length]
};

}  // namespace efree
