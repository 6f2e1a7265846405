// SPDX-License-Identifier: GPL-3.0-or-later
/// Facets whose vertices may come in any order.
#pragma once

#include "efree/core/types.hpp"

#include <array>
#include <utility>

namespace efree::internal {

/// The vertices of a facet, ascending.
template <int Dim> std::array<Index, Dim> sorted_facet(std::array<Index, Dim> facet) {
  if constexpr (Dim == 3)
    if (facet[2] < facet[0]) std::swap(facet[0], facet[2]);
  if (facet[1] < facet[0]) std::swap(facet[0], facet[1]);
  if constexpr (Dim == 3)
    if (facet[2] < facet[1]) std::swap(facet[1], facet[2]);
  return facet;
}

}  // namespace efree::internal
