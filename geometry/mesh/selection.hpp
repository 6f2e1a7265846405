// SPDX-License-Identifier: GPL-3.0-or-later
/// Parts of a boundary that has no names, found by where they are and which way they face.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <variant>

namespace efree {

/// Facets with all their vertices in an axis-parallel box, its sides included.
template <int Dim> struct InBox {
  Vec<Dim> low, high;
  bool operator==(const InBox&) const = default;
};
/// Facets with all their vertices no farther than `tolerance` from a plane (a line in 2D).
template <int Dim> struct OnPlane {
  Vec<Dim> point, normal;  ///< the normal of any length, either way
  double tolerance = 0.0;  ///< [length]; 0: 1e-6 of the diagonal of the body's box
  bool operator==(const OnPlane&) const = default;
};
/// Facets with their outward normal within `angle` of a direction.
template <int Dim> struct Facing {
  Vec<Dim> direction;   ///< of any length
  double angle = 30.0;  ///< [degrees]
  bool operator==(const Facing&) const = default;
};
/// The facet nearest to a point and all that can be reached from it over edges (vertices in 2D) at which the boundary
/// turns by less than `angle`: a side, a fillet, the wall of a hole.
template <int Dim> struct NearestPatch {
  Vec<Dim> point;
  double angle = 30.0;  ///< [degrees]
  bool operator==(const NearestPatch&) const = default;
};
/// Any of them.
template <int Dim> using Selection = std::variant<InBox<Dim>, OnPlane<Dim>, Facing<Dim>, NearestPatch<Dim>>;

/// Boundary facets that are selected, ascending; may be none. Facets that tie two regions (tied_facets) are left out,
/// but for those in the group `open`. Linear in the boundary. Throws InputError for a box with its corners in the wrong
/// order, a direction of length zero, a tolerance that is negative, angles not in (0, 180].
template <int Dim> std::vector<Index> select_facets(const FineMesh<Dim>& mesh, const Selection<Dim>& selection,
                                                    std::string_view open = {});

}  // namespace efree
