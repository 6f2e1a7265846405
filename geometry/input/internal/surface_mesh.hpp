// SPDX-License-Identifier: GPL-3.0-or-later
/// Triangle soups as CGAL's surfaces: `Surface` is CGAL::Surface_mesh of `Point`s, those of
/// CGAL::Exact_predicates_inexact_constructions_kernel, which only sources include.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <utility>
#include <vector>

namespace efree::internal {

template <class Point> std::vector<Point> cgal_points(const SurfaceSoup& soup);
template <class Surface> SurfaceSoup soup_of(const Surface& surface);

/// Throws InputError for a triangle that names a point there is not.
void check_triangles(const SurfaceSoup& soup);

/// The triangles, but repeated ones and those that repeat a corner, turned the same way and joined where they meet in
/// pairs; may be open.
template <class Surface> Surface oriented_surface(const SurfaceSoup& soup);

/// Pairs of triangles that cut through each other or lie on each other. Corners and edges in which sheets touch are
/// none, whether these share them or have copies.
template <class Surface>
std::vector<std::pair<typename Surface::Face_index, typename Surface::Face_index>> crossings(const Surface& surface);

/// The oriented boundary of a body. Throws InputError as mesh_surface does.
template <class Surface> Surface closed_surface(const SurfaceSoup& soup);

/// A closed surface body by body: each with its cavities. Points and faces keep their order.
template <class Surface> std::vector<Surface> separate_bodies(const Surface& closed);

}  // namespace efree::internal
