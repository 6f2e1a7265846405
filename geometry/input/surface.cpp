// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/input/surface.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"
#include "efree/core/internal/reading_bound.hpp"
#include "efree/geometry/input/internal/surface_mesh.hpp"
#include "efree/geometry/mesh/internal/extent.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/stitch_borders.h>
#include <CGAL/Polygon_mesh_processing/triangulate_faces.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>

namespace efree {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;

std::string show(const Kernel::Point_3& p) {
  return fmt::format("({:g}, {:g}, {:g})", p.x(), p.y(), p.z());
}

/// Cuts a polygon, convex or not, into triangles.
void add_triangles(const std::vector<Kernel::Point_3>& points, const std::vector<std::size_t>& polygon,
                   std::vector<std::array<Index, 3>>& out) {
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    out.push_back({static_cast<Index>(a), static_cast<Index>(b), static_cast<Index>(c)});
  };
  if (polygon.size() == 3) return add(polygon[0], polygon[1], polygon[2]);
  Surface face;
  std::vector<Surface::Vertex_index> corners;
  for (const std::size_t v : polygon) corners.push_back(face.add_vertex(points[v]));
  face.add_face(corners);
  pmp::triangulate_faces(face);
  for (const auto f : face.faces()) {
    std::vector<std::size_t> triangle;
    for (const auto v : face.vertices_around_face(face.halfedge(f))) {
      triangle.push_back(polygon[v.idx()]);
      if (triangle.size() > 3) break;  // what could not be cut may go around for ever
    }
    if (triangle.size() == 3) add(triangle[0], triangle[1], triangle[2]);
  }
}

using Corners = std::array<Kernel::Point_3, 3>;
Corners corners(const Surface& surface, Surface::Face_index f) {
  const auto h = surface.halfedge(f);
  return {surface.point(surface.source(h)), surface.point(surface.target(h)),
          surface.point(surface.target(surface.next(h)))};
}

/// Whether two triangles have nothing in common but corners of both, and the edge between two of these.
bool only_touch(Corners a, Corners b) {
  int common = 0;  // corners, moved to the front of both
  for (int i = 0; i < 3; ++i)
    for (int j = common; j < 3; ++j)
      if (a[i] == b[j]) {
        std::swap(a[i], a[common]);
        std::swap(b[j], b[common++]);
        break;
      }
  const auto meets = [](const Corners& opposite, const Corners& other) {
    return CGAL::do_intersect(Kernel::Segment_3(opposite[1], opposite[2]),
                              Kernel::Triangle_3(other[0], other[1], other[2]));
  };
  if (common == 1) return !meets(a, b) && !meets(b, a);
  if (common == 2)
    return !CGAL::coplanar(a[0], a[1], a[2], b[2]) ||
           CGAL::coplanar_orientation(a[0], a[1], a[2], b[2]) != CGAL::POSITIVE;
  return false;
}

}  // namespace

SurfaceSoup read_surface(const std::string& path) {
  const std::string extension = internal::lower_case(std::filesystem::path(path).extension().string());
  if (extension != ".stl" && extension != ".off" && extension != ".obj" && extension != ".ply")
    throw InputError(fmt::format("{}: expected a surface as .stl, .off, .obj or .ply", path));
  if (!std::filesystem::is_regular_file(path) || !std::ifstream(path))
    throw InputError(fmt::format("{}: cannot read the file", path));
  if (std::filesystem::file_size(path) == 0) throw InputError(fmt::format("{}: the file is empty", path));

  std::vector<Kernel::Point_3> points;
  std::vector<std::vector<std::size_t>> polygons;
  bool is_read = false;
  try {
    const internal::ReadingBound bound(path);
    // The name may be in capitals, so that the format is not left to CGAL to tell by it.
    if (extension == ".stl")
      is_read = CGAL::IO::read_STL(path, points, polygons);
    else if (extension == ".off")
      is_read = CGAL::IO::read_OFF(path, points, polygons);
    else if (extension == ".obj")
      is_read = CGAL::IO::read_OBJ(path, points, polygons);
    else
      is_read = CGAL::IO::read_PLY(path, points, polygons);
  } catch (const std::exception&) {
  }
  if (!is_read) throw InputError(fmt::format("{}: the file is truncated or no {} file", path, extension.substr(1)));
  for (const auto& p : points)
    if (!std::isfinite(p.x()) || !std::isfinite(p.y()) || !std::isfinite(p.z()))
      throw InputError(fmt::format("{}: a coordinate is not a finite number, at {}", path, show(p)));
  for (const auto& polygon : polygons)
    for (const std::size_t v : polygon)
      if (v >= points.size())
        throw InputError(fmt::format("{}: a polygon names point {}, but there are {}", path, v, points.size()));
  if (!points.empty()) {
    Vec<3> low = Vec<3>::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const auto& p : points) {
      low = low.cwiseMin(Vec<3>(p.x(), p.y(), p.z()));
      high = high.cwiseMax(Vec<3>(p.x(), p.y(), p.z()));
    }
    internal::require_extent<3>(low, high, path);
  }
  pmp::merge_duplicate_points_in_polygon_soup(points, polygons);

  SurfaceSoup soup;
  for (const auto& polygon : polygons)
    if (polygon.size() >= 3) add_triangles(points, polygon, soup.triangles);
  if (soup.triangles.empty()) throw InputError(fmt::format("{}: there is no triangle in it", path));
  soup.points.resize(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v)
    soup.points.col(static_cast<Eigen::Index>(v)) << points[v].x(), points[v].y(), points[v].z();
  return soup;
}

namespace internal {

template <> std::vector<Kernel::Point_3> cgal_points(const SurfaceSoup& soup) {
  std::vector<Kernel::Point_3> points;
  for (const auto& p : soup.points.colwise()) points.emplace_back(p.x(), p.y(), p.z());
  return points;
}

template <> SurfaceSoup soup_of(const Surface& surface) {
  SurfaceSoup soup;
  std::vector<Index> number(surface.num_vertices());
  soup.points.resize(3, surface.number_of_vertices());
  Index count = 0;
  for (const auto v : surface.vertices()) {
    const auto& p = surface.point(v);
    soup.points.col(count) << p.x(), p.y(), p.z();
    number[v.idx()] = count++;
  }
  for (const auto f : surface.faces()) {
    std::array<Index, 3> triangle{};
    int k = 0;
    for (const auto v : surface.vertices_around_face(surface.halfedge(f))) triangle[k++] = number[v.idx()];
    soup.triangles.push_back(triangle);
  }
  return soup;
}

template <> std::vector<std::pair<Surface::Face_index, Surface::Face_index>> crossings(const Surface& surface) {
  std::vector<std::pair<Surface::Face_index, Surface::Face_index>> pairs;
  pmp::self_intersections<CGAL::Sequential_tag>(surface, std::back_inserter(pairs));
  // Copies of a point or an edge in which sheets touch are counted as meetings, too.
  std::erase_if(
      pairs, [&](const auto& pair) { return only_touch(corners(surface, pair.first), corners(surface, pair.second)); });
  return pairs;
}

void check_triangles(const SurfaceSoup& soup) {
  for (const auto& t : soup.triangles)
    for (const Index v : t)
      if (v < 0 || v >= soup.points.cols())
        throw InputError(fmt::format("surface: a triangle names point {}, but there are {}", v, soup.points.cols()));
}

/// Refuses a surface without an open edge that has more than two triangles at some: bodies that meet in a face, or a
/// face inside a body.
void refuse_shared_faces(const SurfaceSoup& soup) {
  std::map<std::array<double, 3>, Index> places;
  std::vector<Index> joined;
  for (const auto& p : soup.points.colwise())
    joined.push_back(places.try_emplace({p.x(), p.y(), p.z()}, static_cast<Index>(joined.size())).first->second);
  std::map<std::pair<Index, Index>, int> triangles;  // at an edge
  for (const auto& t : soup.triangles)
    for (int k = 0; k < 3; ++k)
      if (const Index a = joined[t[k]], b = joined[t[(k + 1) % 3]]; a != b) ++triangles[std::minmax(a, b)];
  Index crowded = 0;
  Vec<3> first = Vec<3>::Zero();
  for (const auto& [edge, count] : triangles) {
    if (count == 1) return;
    if (count > 2 && crowded++ == 0) first = 0.5 * (soup.points.col(edge.first) + soup.points.col(edge.second));
  }
  if (crowded > 0)
    throw InputError(fmt::format(
        "the surface holds bodies that meet in a common face, or a face inside a body: {} edge{} of more than two "
        "triangles, first at ({:g}, {:g}, {:g}); expected closed bodies apart from each other. Unite them in CAD, or "
        "mesh them as one body with [geometry.surface] mesher = \"lattice\"; bodies that are not bonded need a gap, "
        "1e-6 of their size will do",
        crowded, crowded == 1 ? "" : "s", first.x(), first.y(), first.z()));
}

template <> Surface oriented_surface(const SurfaceSoup& soup) {
  auto points = cgal_points<Kernel::Point_3>(soup);
  std::vector<std::vector<std::size_t>> polygons;
  for (const auto& t : soup.triangles)
    polygons.push_back(
        {static_cast<std::size_t>(t[0]), static_cast<std::size_t>(t[1]), static_cast<std::size_t>(t[2])});
  pmp::repair_polygon_soup(points, polygons);
  // Where sheets touch in a point or an edge this gives each its own copy.
  pmp::orient_polygon_soup(points, polygons);
  Surface surface;
  pmp::polygon_soup_to_polygon_mesh(points, polygons, surface);
  pmp::stitch_borders(surface);
  return surface;
}

template <> Surface closed_surface(const SurfaceSoup& soup) {
  check_triangles(soup);
  Surface surface = oriented_surface<Surface>(soup);
  if (surface.number_of_faces() == 0) throw InputError("surface: there is no triangle in it");
  int open = 0;
  Kernel::Point_3 first;
  for (const auto h : surface.halfedges())
    if (surface.is_border(h) && open++ == 0)
      first = CGAL::midpoint(surface.point(surface.source(h)), surface.point(surface.target(h)));
  if (open > 0) {
    refuse_shared_faces(soup);
    throw InputError(fmt::format("open surface given as closed: {} boundary edge{}, first at {}; repair it or wrap it",
                                 open, open == 1 ? "" : "s", show(first)));
  }

  if (const auto crossing = crossings(surface); !crossing.empty()) {
    const auto h = surface.halfedge(crossing.front().first);
    throw InputError(fmt::format("the surface meets itself: {} pair{} of triangles, first at {}; repair it or wrap it",
                                 crossing.size(), crossing.size() == 1 ? "" : "s",
                                 show(CGAL::centroid(surface.point(surface.source(h)), surface.point(surface.target(h)),
                                                     surface.point(surface.target(surface.next(h)))))));
  }
  pmp::orient_to_bound_a_volume(surface);
  const Vec<3> extent = soup.points.rowwise().maxCoeff() - soup.points.rowwise().minCoeff();
  if (const double volume = pmp::volume(surface); !(volume > 1e-12 * std::pow(extent.norm(), 3)))
    throw InputError(fmt::format("the surface encloses no volume ({:g} in a box {:g} x {:g} x {:g})", volume,
                                 extent.x(), extent.y(), extent.z()));
  return surface;
}

template <> std::vector<Surface> separate_bodies(const Surface& closed) {
  Surface surface = closed;
  auto body_of = surface.add_property_map<Surface::Face_index, std::size_t>("f:body", 0).first;
  const std::size_t count =
      pmp::volume_connected_components(surface, body_of, CGAL::parameters::do_orientation_tests(false));
  if (count <= 1) return {closed};
  std::vector<Surface> bodies(count);
  // A point belongs to one body: where bodies touch each has a copy of its own.
  std::vector<Surface::Vertex_index> copy(surface.number_of_vertices());
  for (const auto v : surface.vertices())
    copy[v] = bodies[body_of[surface.face(surface.halfedge(v))]].add_vertex(surface.point(v));
  for (const auto f : surface.faces()) {
    std::array<Surface::Vertex_index, 3> corners;
    int k = 0;
    for (const auto v : surface.vertices_around_face(surface.halfedge(f))) corners[k++] = copy[v];
    bodies[body_of[f]].add_face(corners[0], corners[1], corners[2]);
  }
  return bodies;
}

}  // namespace internal
}  // namespace efree
