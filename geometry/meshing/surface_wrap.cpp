// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL Alpha_wrap_3, in a file of its own because it is slow to compile.
#include "efree/core/error.hpp"
#include "efree/geometry/input/internal/surface_mesh.hpp"
#include "efree/geometry/input/surface.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/alpha_wrap_3.h>
#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace efree {

SurfaceWrap wrap_surface(const SurfaceSoup& soup, const WrapOptions& options) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Triangles = std::vector<Kernel::Triangle_3>;
  using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
  if (soup.triangles.empty()) throw InputError("wrap: there is no triangle in the surface");
  if (!(options.alpha >= 0.0 && options.offset >= 0.0))
    throw InputError(fmt::format("wrap: alpha is {}, offset {}, expected positive lengths, or 0 for the defaults",
                                 options.alpha, options.offset));
  const auto points = internal::cgal_points<Kernel::Point_3>(soup);
  std::vector<std::array<std::size_t, 3>> faces;
  Triangles triangles;
  for (const auto& t : soup.triangles) {
    for (const Index v : t)
      if (v < 0 || v >= soup.points.cols())
        throw InputError(fmt::format("wrap: a triangle names point {}, but there are {}", v, soup.points.cols()));
    const Kernel::Triangle_3 triangle(points[t[0]], points[t[1]], points[t[2]]);
    if (triangle.is_degenerate()) continue;
    triangles.push_back(triangle);
    faces.push_back({static_cast<std::size_t>(t[0]), static_cast<std::size_t>(t[1]), static_cast<std::size_t>(t[2])});
  }
  if (triangles.empty()) throw InputError("wrap: all triangles of the surface are degenerate");
  const double diagonal = (soup.points.rowwise().maxCoeff() - soup.points.rowwise().minCoeff()).norm();
  SurfaceWrap wrap;
  wrap.alpha = options.alpha > 0.0 ? options.alpha : diagonal / 50.0;
  wrap.offset = options.offset > 0.0 ? options.offset : wrap.alpha / 30.0;
  if (constexpr double finest = 5e-4; wrap.alpha < finest * diagonal || wrap.offset < 1e-2 * finest * diagonal)
    throw InputError(
        fmt::format("wrap: alpha {:g} and offset {:g} are too small for a box of diagonal {:g}; expected "
                    "at least {:g} and {:g}",
                    wrap.alpha, wrap.offset, diagonal, finest * diagonal, 1e-2 * finest * diagonal));

  CGAL::Surface_mesh<Kernel::Point_3> closed;
  CGAL::alpha_wrap_3(points, faces, wrap.alpha, wrap.offset, closed);
  wrap.surface = internal::soup_of(closed);
  wrap.volume = CGAL::Polygon_mesh_processing::volume(closed);
  const CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>> tree(triangles.cbegin(), triangles.cend());
  const auto distance = [&](const Vec<3>& p) {
    const double found = std::sqrt(tree.squared_distance({p.x(), p.y(), p.z()}));
    wrap.max_distance = std::max(wrap.max_distance, found);
    return found;
  };
  // Vertices are about `offset` away by construction; what bridges a hole shows in the middle of the triangles.
  for (const auto& p : wrap.surface.points.colwise()) distance(p);
  double area = 0.0;
  for (const auto& t : wrap.surface.triangles) {
    const Vec<3> p = wrap.surface.points.col(t[0]), q = wrap.surface.points.col(t[1]),
                 r = wrap.surface.points.col(t[2]);
    const double part = 0.5 * (q - p).cross(r - p).norm();
    area += part;
    wrap.mean_distance += part * distance((p + q + r) / 3.0);
  }
  wrap.mean_distance /= area;
  // Around both sides of a sheet that the wrap could enter, through a hole or because it is open.
  if (const double thickness = 2.0 * wrap.volume / area; thickness < 3.0 * wrap.offset)
    throw InputError(fmt::format(
        "wrap: it encloses no body but a skin {:.2g} thick around the triangles, which is what the offset {:g} "
        "makes of an open sheet; close its holes, or wrap it with an alpha (now {:g}) wider than they are",
        thickness, wrap.offset, wrap.alpha));
  return wrap;
}

}  // namespace efree
