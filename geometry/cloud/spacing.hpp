// SPDX-License-Identifier: GPL-3.0-or-later
/// How densely nodes should lie: a packing size for every fine vertex, finer around small features, in boxes, in
/// regions and towards parts of the boundary.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <array>
#include <string>
#include <vector>

namespace efree {

/// Spacing inside an axis-parallel box; its first Dim coordinates count.
struct SpacingBox {
  std::array<double, 3> low{}, high{};
  double spacing = 0.0;
};

/// Spacing in a named region of the mesh.
struct SpacingRegion {
  std::string region;
  double spacing = 0.0;
};

/// Spacing on a named part of the boundary.
struct SpacingBoundary {
  std::string boundary;
  double spacing = 0.0;
};

/// What makes a cloud denser than its spacing H. Nothing of it is on by default.
struct Grading {
  bool features = false;  ///< around features (ligaments, holes, tips) of size s < 4 H: a spacing of sqrt(s H) / 2
  double growth = 0.2;    ///< the spacing grows by no more than this times the length of any fine edge
  double least = 2.0;     ///< features are given spacings no smaller than this many mean fine edges at the place
  std::vector<SpacingBox> boxes{};
  std::vector<SpacingRegion> regions{};
  std::vector<SpacingBoundary> boundaries{};
  double scale = 1.0;  ///< of all that comes of this

  /// Whether a spacing is asked for at some place.
  bool has_places() const { return !boxes.empty() || !regions.empty() || !boundaries.empty(); }
};

/// Packing size at every fine vertex: the least of `spacing` and of what features, boxes, regions and boundaries ask
/// for, with the growth limited (Borouchaki, Hecht, Frey 1998). Constant where nothing is asked for. Why the square
/// root: around a hole of radius r the error in energy of linear functions is about H^2 times the squared second
/// derivatives, r^4 / x^6; least for a given number of nodes it is at H ~ sqrt(r) on the rim of each hole. Cost about
/// that of sampling the cloud. Throws InputError for lengths that are not positive, a box without a fine vertex, an
/// unknown region or boundary, and a spacing asked for at a place that is below the fine edges there.
template <int Dim> Vector graded_spacing(const FineMesh<Dim>& mesh, double spacing, const Grading& grading);

/// Size of the feature each vertex belongs to, as far as it is below `largest`, else infinity. On boundary vertices the
/// diameter of the bend: that of the circle or sphere whose normals cancel as much as those of the connected boundary
/// within reach; so holes, pores, rounded edges and slit tips are features and staircases of pixels are none. On the
/// middle surface of ligaments, sheets and gaps between holes their thickness.
template <int Dim> Vector feature_size(const FineMesh<Dim>& mesh, double largest);

/// The largest field below `spacing` that differs along each fine edge by at most `growth` times its length, and not
/// between the two sides of an interface (tied_facets).
template <int Dim> Vector limit_growth(const FineMesh<Dim>& mesh, Vector spacing, double growth);

}  // namespace efree
