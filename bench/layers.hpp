// SPDX-License-Identifier: GPL-3.0-or-later
/// Bodies of two materials whose regions share vertices, as finite elements take them.
#pragma once

#include "efree/geometry/meshing/planar_domain.hpp"

#include <algorithm>
#include <functional>
#include <vector>

namespace efree::bench {

/// The mesh with the cells whose centroid `is_second` in a second region.
template <int Dim>
MeshData<Dim> in_two_regions(MeshData<Dim> data, const std::function<bool(const Vec<Dim>&)>& is_second) {
  data.region_names = {"first", "second"};
  data.regions.clear();
  for (Index c = 0; c < data.cells.cols(); ++c) {
    Vec<Dim> x = Vec<Dim>::Zero();
    for (int i = 0; i <= Dim; ++i) x += data.vertices.col(data.cells(i, c)) / (Dim + 1.0);
    data.regions.push_back(is_second(x));
  }
  return data;
}

/// Rectangle (sides left, right, bottom, top) in layers across `axis` that end at these places; every other one is in
/// a second region.
inline MeshData<2> layers(const Vec<2>& low, const Vec<2>& high, int axis, const std::vector<double>& ends,
                          double size) {
  PlanarDomain domain = shapes::rectangle(low.x(), low.y(), high.x(), high.y());
  for (const double end : ends) {
    Vec<2> from = low, to = high;
    from[axis] = to[axis] = end;
    domain.embedded.push_back({"", {from, to}});
  }
  return in_two_regions<2>(triangulate_data(domain, {.size = size}), [&](const Vec<2>& x) {
    return std::ranges::count_if(ends, [&](double end) { return end < x[axis]; }) % 2 == 1;
  });
}

/// The unit cube, in cells of a lattice of an even number of cubes along each axis, with an eighth of a ball of radius
/// 1/2 around the origin in a second region.
inline MeshData<3> with_ball(MeshData<3> cube) {
  cube = in_two_regions<3>(std::move(cube), [](const Vec<3>& x) { return x.maxCoeff() < 0.5; });
  for (Index v = 0; v < cube.vertices.cols(); ++v) {
    auto x = cube.vertices.col(v);
    const double s = 2.0 * x.maxCoeff(), w = s <= 1.0 ? s : 2.0 - s;
    if (w > 0.0) x *= 1.0 - w + 0.5 * w * s / x.norm();
  }
  return cube;
}

/// Whether cells of several regions meet in a mesh: moving least squares do not know such, nor do corrections.
template <int Dim> bool shares_vertices(const FineMesh<Dim>& mesh) {
  return mesh.num_regions() > 1 && tied_facets(mesh).empty();
}

}  // namespace efree::bench
