// SPDX-License-Identifier: GPL-3.0-or-later
/// Triangle soups as CGAL's surfaces.
#pragma once

#include "efree/geometry/input/surface.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#include <utility>
#include <vector>

namespace efree::internal {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;

std::vector<Kernel::Point_3> cgal_points(const SurfaceSoup& soup);
SurfaceSoup soup_of(const Surface& surface);

/// Throws InputError for a triangle that names a point there is not.
void check_triangles(const SurfaceSoup& soup);

/// The triangles, but repeated ones and those that repeat a corner, turned the same way and joined where they meet in
/// pairs; may be open.
Surface oriented_surface(const SurfaceSoup& soup);

/// Pairs of triangles that cut through each other or lie on each other. Corners and edges in which sheets touch are
/// none, whether these share them or have copies.
std::vector<std::pair<Surface::Face_index, Surface::Face_index>> crossings(const Surface& surface);

/// The oriented boundary of a body. Throws InputError as mesh_surface does.
Surface closed_surface(const SurfaceSoup& soup);

}  // namespace efree::internal
