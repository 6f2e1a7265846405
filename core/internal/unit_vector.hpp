// SPDX-License-Identifier: GPL-3.0-or-later
/// Directions. Internal to the library.
#pragma once

#include "efree/core/types.hpp"

namespace efree::internal {

/// Along a vector of any length but zero, however large or small: squares of 1e300 and 1e-300 are no numbers to divide
/// by.
template <int Dim> Vec<Dim> unit_vector(const Vec<Dim>& along) {
  return along.stableNormalized().normalized();
}

}  // namespace efree::internal
