// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/surface_check.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/disjoint_sets.hpp"
#include "efree/core/internal/infinity.hpp"
#include "efree/geometry/input/internal/surface_mesh.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace efree {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;

using internal::infinity;

/// Normal of a triangle times its area.
Vec<3> area_vector(const SurfaceSoup& soup, Index t) {
  const auto& [a, b, c] = soup.triangles[t];
  const Vec<3> p = soup.points.col(a);
  return 0.5 * (soup.points.col(b) - p).cross(soup.points.col(c) - p);
}

/// A side of a triangle, and whether it runs from the smaller number of a point to the larger.
struct Side {
  Index triangle;
  bool ascending;
};
using Edges = std::map<std::pair<Index, Index>, std::vector<Side>>;
Edges edges_of(const SurfaceSoup& soup) {
  Edges edges;
  for (Index t = 0; t < static_cast<Index>(soup.triangles.size()); ++t)
    for (int k = 0; k < 3; ++k) {
      const Index a = soup.triangles[t][k], b = soup.triangles[t][(k + 1) % 3];
      if (a != b) edges[std::minmax(a, b)].push_back({t, a < b});
    }
  return edges;
}

void find_groups(SurfaceCheck& check, double feature_angle) {
  const SurfaceSoup& soup = check.surface;
  const auto count = static_cast<Index>(soup.triangles.size());
  const double cosine = std::cos(feature_angle * std::numbers::pi / 180.0);
  internal::DisjointSets sets(count);
  for (const auto& [edge, sides] : edges_of(soup)) {
    if (sides.size() != 2) continue;
    const Vec<3> a = area_vector(soup, sides[0].triangle).normalized(),
                 b = area_vector(soup, sides[1].triangle).normalized();
    // Neighbours that are turned the same way pass their edge in opposite directions.
    const double turn = sides[0].ascending != sides[1].ascending ? a.dot(b) : -a.dot(b);
    if (turn >= cosine) sets.join(sides[0].triangle, sides[1].triangle);
  }
  const std::vector<Index> part = std::move(sets).firsts();
  std::map<Index, GroupSummary<3>> groups;
  for (Index t = 0; t < count; ++t) {
    auto& group = groups.try_emplace(part[t], GroupSummary<3>{"", 0, 0.0, {}, {}, Vec<3>::Zero()}).first->second;
    const Vec<3> area = area_vector(soup, t);
    ++group.num_facets;
    group.measure += area.norm();
    group.mean_normal += area;
    for (const Index v : soup.triangles[t]) {
      group.box.extend(soup.points.col(v));
    }
  }
  std::vector<Index> roots;
  for (auto& [root, group] : groups) {
    if (group.measure > 0.0) group.mean_normal /= group.measure;
    // A mean as long as that leaves no normal of weight that is off.
    if (1.0 - group.mean_normal.norm() < 1e-9) group.normal = group.mean_normal.normalized();
    roots.push_back(root);
  }
  std::ranges::stable_sort(roots, std::ranges::greater{}, [&](Index root) { return groups.at(root).measure; });
  std::map<Index, Index> number;
  for (const Index root : roots) {
    number[root] = static_cast<Index>(check.groups.size());
    check.groups.push_back(groups.at(root));
    check.groups.back().name = fmt::format("surface {}", check.groups.size());
  }
  for (Index t = 0; t < count; ++t) check.group_of.push_back(number.at(part[t]));
}

std::optional<SurfaceCheck::Wall> thinnest_wall(const SurfaceSoup& soup) {
  using Triangles = std::vector<Kernel::Triangle_3>;
  using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
  const auto points = internal::cgal_points<Kernel::Point_3>(soup);
  Triangles triangles;
  for (const auto& t : soup.triangles) triangles.emplace_back(points[t[0]], points[t[1]], points[t[2]]);
  const CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>> tree(triangles.cbegin(), triangles.cend());
  std::optional<SurfaceCheck::Wall> thinnest;
  for (auto t = triangles.cbegin(); t != triangles.cend(); ++t) {
    const Vec<3> normal = area_vector(soup, static_cast<Index>(t - triangles.cbegin())).normalized();
    const Kernel::Point_3 start = CGAL::centroid(*t);
    const Kernel::Ray_3 inward(start, Kernel::Vector_3(-normal.x(), -normal.y(), -normal.z()));
    const auto hit =
        tree.first_intersection(inward, [&](const Triangles::const_iterator& other) { return other == t; });
    if (!hit) continue;
    const auto* place = boost::get<Kernel::Point_3>(&hit->first);
    if (!place) continue;
    // Sides of a corner meet in it; only walls that face each other have a thickness.
    const Vec<3> opposite = area_vector(soup, static_cast<Index>(hit->second - triangles.cbegin())).normalized();
    if (normal.dot(opposite) > -0.8) continue;
    const double thickness = std::sqrt(CGAL::squared_distance(start, *place));
    if (!thinnest || thickness < thinnest->thickness)
      thinnest = SurfaceCheck::Wall{thickness, {start.x(), start.y(), start.z()}};
  }
  return thinnest;
}

}  // namespace

double default_surface_size(const SurfaceSoup& soup) {
  return (soup.points.rowwise().maxCoeff() - soup.points.rowwise().minCoeff()).norm() / 40.0;
}

SurfaceCheck check_surface(const SurfaceSoup& soup, double feature_angle) {
  if (soup.triangles.empty()) throw InputError("surface: there is no triangle in it");
  internal::check_triangles(soup);
  SurfaceCheck check;
  check.triangles = static_cast<Index>(soup.triangles.size());
  check.points = static_cast<Index>(soup.points.cols());
  check.box = {soup.points.rowwise().minCoeff(), soup.points.rowwise().maxCoeff()};
  const double diagonal = check.box.diagonal().norm();
  check.shortest_edge = infinity;
  internal::DisjointSets shells(check.points);
  std::vector<char> used(soup.points.cols(), 0);
  for (Index t = 0; t < check.triangles; ++t) {
    const double area = area_vector(soup, t).norm();
    check.area += area;
    const bool flat = area <= 1e-14 * diagonal * diagonal;
    check.degenerate += flat;
    for (int k = 0; k < 3; ++k) {
      const Index a = soup.triangles[t][k], b = soup.triangles[t][(k + 1) % 3];
      shells.join(a, b);
      used[a] = 1;
      if (flat) continue;
      const double edge = (soup.points.col(a) - soup.points.col(b)).norm();
      check.shortest_edge = std::min(check.shortest_edge, edge);
      check.longest_edge = std::max(check.longest_edge, edge);
    }
  }
  if (check.longest_edge == 0.0) check.shortest_edge = 0.0;
  const std::vector<Index> shell = std::move(shells).firsts();
  for (Index v = 0; v < check.points; ++v) check.shells += used[v] && shell[v] == v;
  for (const auto& [edge, sides] : edges_of(soup)) {
    check.open_edges += sides.size() == 1;
    check.crowded_edges += sides.size() > 2;
  }
  try {
    const auto closed = internal::closed_surface<Surface>(soup);
    check.volume = pmp::volume(closed);
    check.surface = internal::soup_of(closed);
    check.thinnest = thinnest_wall(check.surface);
  } catch (const InputError& error) {
    check.fault = error.what();
    check.surface = soup;
    check.crossings = static_cast<Index>(internal::crossings(internal::oriented_surface<Surface>(soup)).size());
  }
  find_groups(check, feature_angle);
  const double size = default_surface_size(soup);
  check.gaps = find_gaps(soup, size, 0.5 * size);
  return check;
}

}  // namespace efree
