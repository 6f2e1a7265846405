// SPDX-License-Identifier: GPL-3.0-or-later
/// Selections on a boundary of any kind: of a mesh, of the voxels of an image. Internal to the library.
#pragma once

#include "efree/core/error.hpp"
#include "efree/core/internal/unit_vector.hpp"
#include "efree/geometry/mesh/selection.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace efree::internal {

/// Facets of a boundary that selections have, ascending. The boundary has
///   size()                       number of its facets
///   can_be_selected(f)
///   all_corners(f, wanted)       whether wanted(x) holds at every corner of a facet
///   normal(f)                    outward, of length 1
///   squared_distance(f, x)       of a point
///   visit_neighbours(f, visit)   calls visit(g, turn) for the facets that share an edge (a vertex in 2D) with f;
///                                turn() is the cosine of the angle by which the boundary turns there
///   diagonal()                   of the body's box [length]
/// Throws InputError as efree::select_facets.
template <int Dim, class Boundary> class FacetSelector {
 public:
  explicit FacetSelector(const Boundary& boundary) : boundary_(boundary) {}

  std::vector<Index> operator()(const InBox<Dim>& box) const {
    if (!(box.low.array() <= box.high.array()).all())
      throw InputError(
          fmt::format("box from {} to {}, expected its lowest corner first", shown(box.low), shown(box.high)));
    const double rounding = 1e-9 * boundary_.diagonal();
    return facets_where([&](Index f) {
      return boundary_.all_corners(f, [&](const Vec<Dim>& x) {
        return (x.array() >= box.low.array() - rounding).all() && (x.array() <= box.high.array() + rounding).all();
      });
    });
  }
  std::vector<Index> operator()(const OnPlane<Dim>& plane) const {
    if (!(plane.tolerance >= 0.0))
      throw InputError(fmt::format("tolerance = {}, expected a length that is not negative", plane.tolerance));
    const Vec<Dim> n = unit(plane.normal);
    const double tolerance = plane.tolerance > 0.0 ? plane.tolerance : 1e-6 * boundary_.diagonal();
    return facets_where([&](Index f) {
      return boundary_.all_corners(f, [&](const Vec<Dim>& x) { return std::abs(n.dot(x - plane.point)) <= tolerance; });
    });
  }
  std::vector<Index> operator()(const Facing<Dim>& facing) const {
    const Vec<Dim> n = unit(facing.direction);
    const double least = cosine(facing.angle);
    return facets_where([&](Index f) { return boundary_.normal(f).dot(n) >= least; });
  }
  std::vector<Index> operator()(const NearestPatch<Dim>& wanted) const {
    const double least = cosine(wanted.angle);
    Index nearest = -1;
    double distance = std::numeric_limits<double>::infinity();
    for (Index f = 0; f < boundary_.size(); ++f) {
      if (!boundary_.can_be_selected(f)) continue;
      const double here = boundary_.squared_distance(f, wanted.point);
      if (here < distance) nearest = f, distance = here;
    }
    if (nearest < 0) return {};
    std::vector<char> seen(boundary_.size(), 0);
    std::vector<Index> patch{nearest};
    seen[nearest] = 1;
    for (std::size_t k = 0; k < patch.size(); ++k)
      boundary_.visit_neighbours(patch[k], [&](Index g, const auto& turn) {
        if (seen[g] || !boundary_.can_be_selected(g) || turn() < least) return;
        seen[g] = 1;
        patch.push_back(g);
      });
    std::ranges::sort(patch);
    return patch;
  }

 private:
  static std::string shown(const Vec<Dim>& x) { return fmt::format("({:.6g})", fmt::join(x, ", ")); }
  static double cosine(double degrees) {
    if (!(degrees > 0.0 && degrees <= 180.0))
      throw InputError(fmt::format("angle = {}, expected a number in (0, 180] degrees", degrees));
    // Facets that lie exactly at the angle belong to it, whatever rounding says.
    return std::cos(degrees * std::numbers::pi / 180.0) - 1e-12;
  }
  static Vec<Dim> unit(const Vec<Dim>& direction) {
    if (direction.isZero(0.0) || !direction.allFinite())
      throw InputError(fmt::format("normal = {}, expected a direction", shown(direction)));
    return unit_vector<Dim>(direction);
  }
  template <class Predicate> std::vector<Index> facets_where(const Predicate& wanted) const {
    std::vector<Index> facets;
    for (Index f = 0; f < boundary_.size(); ++f)
      if (boundary_.can_be_selected(f) && wanted(f)) facets.push_back(f);
    return facets;
  }

  const Boundary& boundary_;
};

}  // namespace efree::internal
