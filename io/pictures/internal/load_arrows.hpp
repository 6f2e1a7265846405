// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on the boundary as arrows.
#pragma once

#include "efree/assembly/conditions.hpp"
#include "efree/io/pictures/internal/scene.hpp"

#include <functional>
#include <string>
#include <vector>

namespace efree::internal::drawing {

/// A piece of the boundary that may be loaded.
template <int Dim> struct LoadedFacet {
  Vec<Dim> at, normal;  ///< its middle, and the unit normal outwards
  double area;
  Index point;  ///< of the picture's body, that moves as the facet does
};
/// The traction at one place.
struct LoadArrow {
  Vec3 at, traction;
  bool presses;  ///< against the body: then the tip is at the place, else the tail
  Index point;   ///< as of the facet
};

/// Tractions, pressures, forces and moments on parts, whose facets `facets_of` returns by name: at most one arrow for
/// each part in a cube of side `gap`.
template <int Dim> std::vector<LoadArrow> load_arrows(
    const Loads<Dim>& loads, const std::function<std::vector<LoadedFacet<Dim>>(const std::string& part)>& facets_of,
    double gap);

/// Draws them, the largest traction `length` long; points have moved by `moved`.
void draw_arrows(Canvas& canvas, const Projection& at, const std::vector<LoadArrow>& arrows, const Points<3>& moved,
                 double length, const Colour& colour);

}  // namespace efree::internal::drawing
