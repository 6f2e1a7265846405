// SPDX-License-Identifier: GPL-3.0-or-later
/// Gas in cavities.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <tuple>

namespace efree {

/// Gas inside a closed surface of nodes, with constant p V^exponent.
template <int Dim> struct GasCavity {
  Facets<Dim> facets;     ///< of nodes, all oriented outwards or all inwards
  double pressure = 0.0;  ///< at the start, over that outside
  double exponent = 1.4;
  friend auto fields(GasCavity& of) {
    auto& [facets, pressure, exponent] = of;
    return std::tie(facets, pressure, exponent);
  }
};

}  // namespace efree
