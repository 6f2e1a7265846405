// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL Mesh_3, in a file of its own because it is slow to compile.
#include "efree/core/error.hpp"
#include "efree/core/memory.hpp"
#include "efree/geometry/input/internal/surface_mesh.hpp"
#include "efree/geometry/input/surface.hpp"
#include "efree/geometry/mesh/internal/flat_cells.hpp"
#include "efree/geometry/mesh/refine.hpp"
#include "efree/geometry/mesh/spatial_order.hpp"
#include "efree/geometry/meshing/internal/narrow_gaps.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polyhedral_mesh_domain_with_features_3.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/make_mesh_3.h>
#include <CGAL/property_map.h>
#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <queue>
#include <tuple>
#include <unordered_map>

namespace efree {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;
using Domain = CGAL::Polyhedral_mesh_domain_with_features_3<Kernel, Surface>;
using Triangulation = CGAL::Mesh_triangulation_3<Domain, CGAL::Default, CGAL::Sequential_tag>::type;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation, Domain::Corner_index, Domain::Curve_index>;
using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

/// Normals of the surface's triangles; a sliver lower than `tolerance` has that of the neighbour it shares most of its
/// boundary with, as its own says nothing.
std::vector<Kernel::Vector_3> steady_normals(const Surface& surface, double tolerance) {
  constexpr double sliver = 0.05;  // height over longest edge
  std::vector<Kernel::Vector_3> normals;
  std::vector<char> known;
  const auto length = [&](Surface::Halfedge_index h) {
    return std::sqrt(CGAL::squared_distance(surface.point(surface.source(h)), surface.point(surface.target(h))));
  };
  for (const auto f : surface.faces()) {
    const auto h = surface.halfedge(f);
    const auto &a = surface.point(surface.source(h)), &b = surface.point(surface.target(h)),
               &c = surface.point(surface.target(surface.next(h)));
    normals.push_back(CGAL::cross_product(b - a, c - a));
    const double area = std::sqrt(normals.back().squared_length()),
                 longest = std::max({length(h), length(surface.next(h)), length(surface.prev(h))});
    known.push_back(area > tolerance * longest || area > sliver * longest * longest);
    if (known.back()) normals.back() = normals.back() / area;
  }
  if (std::ranges::count(known, 1) == 0) return normals;
  using Border = std::tuple<double, std::size_t, std::size_t>;  // length, to, from
  std::priority_queue<Border> next;
  const auto push_neighbours = [&](Surface::Face_index f) {
    for (const auto h : surface.halfedges_around_face(surface.halfedge(f)))
      if (const auto other = surface.face(surface.opposite(h)); !known[other]) next.emplace(length(h), other, f);
  };
  for (const auto f : surface.faces())
    if (known[f]) push_neighbours(f);
  while (!next.empty()) {
    const auto [shared, to, from] = next.top();
    next.pop();
    if (known[to]) continue;
    known[to] = 1;
    normals[to] = normals[from];
    push_neighbours(Surface::Face_index(static_cast<Surface::size_type>(to)));
  }
  return normals;
}

/// Takes the rims of narrow gaps from the sharp edges.
void forget_rims(Surface& surface, double size) {
  const auto is_sharp = get(CGAL::edge_is_feature, surface);
  const auto rims = internal::rims_of_gaps(internal::soup_of(surface), internal::narrow_share * size, size);
  std::vector<Index> number(surface.num_vertices());  // as soup_of counts
  Index count = 0;
  for (const auto v : surface.vertices()) number[v] = count++;
  for (const auto e : surface.edges()) {
    const Index a = number[surface.source(surface.halfedge(e))], b = number[surface.target(surface.halfedge(e))];
    if (rims.contains({std::min(a, b), std::max(a, b)})) put(is_sharp, e, false);
  }
}

/// Finds the edges at which the surface turns by more than `angle`, whatever the slivers beside them say, but for rims
/// of narrow gaps, and numbers the patches between them from 1, in the properties that Mesh_3 reads. Two sides of a
/// strip of slivers would both be sharp, and be covered with balls smaller than the gap between them, any number of
/// them where it closes.
void mark_sharp_edges(Surface& surface, double angle, double tolerance, double size) {
  const auto is_sharp = get(CGAL::edge_is_feature, surface);
  const auto patch = get(CGAL::face_patch_id_t<Domain::Patch_id>(), surface);
  const auto normals = steady_normals(surface, tolerance);
  const double cosine = std::cos(angle * std::numbers::pi / 180.0);
  for (const auto e : surface.edges()) {
    const auto h = surface.halfedge(e);
    put(is_sharp, e, angle < 180.0 && normals[surface.face(h)] * normals[surface.face(surface.opposite(h))] < cosine);
  }
  if (angle < 180.0) forget_rims(surface, size);
  CGAL::Polygon_mesh_processing::connected_components(surface, patch,
                                                      CGAL::parameters::edge_is_constrained_map(is_sharp));
  for (const auto f : surface.faces()) put(patch, f, get(patch, f) + 1);
}

/// Gives the domain the sharp edges as curves from corner to corner: where other than two of them meet, or two in an
/// acute angle. Closed ones start anywhere. Where sheets of the surface touch, copies of an edge are one curve, and
/// curves that pass through copies of a point end there: Mesh_3 would never be done with telling them apart.
void add_curves(Surface& surface, Domain& domain) {
  using Curve = std::pair<std::vector<Kernel::Point_3>, std::vector<Domain::Patch_id>>;
  const auto patch = get(CGAL::face_patch_id_t<Domain::Patch_id>(), surface);
  const auto is_sharp = get(CGAL::edge_is_feature, surface);
  std::vector<std::size_t> first_of(surface.num_vertices());  // of all vertices in the same place
  std::map<Kernel::Point_3, std::size_t> places;
  for (const auto v : surface.vertices()) first_of[v] = places.emplace(surface.point(v), v.idx()).first->second;

  struct Edge {
    std::array<std::size_t, 2> ends;
    std::vector<Domain::Patch_id> patches;
    bool done = false;
  };
  std::vector<Edge> edges;
  std::map<std::array<std::size_t, 2>, std::size_t> edge_between;
  std::vector<std::vector<std::size_t>> at(surface.num_vertices());  // edges that meet in a place
  for (const auto e : surface.edges()) {
    if (!get(is_sharp, e)) continue;
    const auto h = surface.halfedge(e);
    std::array<std::size_t, 2> ends{first_of[surface.source(h)], first_of[surface.target(h)]};
    std::ranges::sort(ends);
    const auto [found, is_new] = edge_between.emplace(ends, edges.size());
    if (is_new) {
      for (const std::size_t end : ends) at[end].push_back(edges.size());
      edges.push_back({ends, {}});
    }
    for (const auto side : {h, surface.opposite(h)})
      edges[found->second].patches.push_back(get(patch, surface.face(side)));
  }
  const auto point = [&](std::size_t v) {
    return surface.point(Surface::Vertex_index(static_cast<Surface::size_type>(v)));
  };
  const auto other_end = [&](std::size_t e, std::size_t v) { return edges[e].ends[edges[e].ends[0] == v]; };
  const auto is_corner = [&](std::size_t v) {
    return at[v].size() != 2 ||
           CGAL::angle(point(other_end(at[v][0], v)), point(v), point(other_end(at[v][1], v))) == CGAL::ACUTE;
  };
  std::vector<Curve> curves;
  const auto trace = [&](std::size_t start, std::size_t e) {
    Curve curve{{point(start)}, {}};
    for (std::size_t v = start;;) {
      edges[e].done = true;
      v = other_end(e, v);
      curve.first.push_back(point(v));
      curve.second.insert(curve.second.end(), edges[e].patches.begin(), edges[e].patches.end());
      if (v == start || is_corner(v)) break;
      e = at[v][at[v][0] == e];
    }
    std::ranges::sort(curve.second);
    const auto [first, last] = std::ranges::unique(curve.second);
    curve.second.erase(first, last);
    curves.push_back(std::move(curve));
  };
  for (const bool closed : {false, true})
    for (std::size_t v = 0; v < at.size(); ++v)
      if (closed || is_corner(v))
        for (const std::size_t e : at[v])
          if (!edges[e].done) trace(v, e);
  domain.add_features_and_incidences(curves.begin(), curves.end(), CGAL::First_of_pair_property_map<Curve>(),
                                     CGAL::Second_of_pair_property_map<Curve>());
}

/// Points on every connected part of the surface, so that none is missed: Mesh_3 finds parts without a sharp edge only
/// by rays from the middle of all.
void insert_initial_points(const Surface& surface, const Domain& domain, Complex& complex) {
  constexpr std::size_t most_points = 20;
  auto part_of = surface.property_map<Surface::Face_index, std::size_t>("f:part").first;
  std::vector<std::vector<Surface::Face_index>> parts;
  for (const auto f : surface.faces()) {
    if (part_of[f] >= parts.size()) parts.resize(part_of[f] + 1);
    parts[part_of[f]].push_back(f);
  }
  const auto intersection = domain.construct_intersection_object();
  auto& triangulation = complex.triangulation();
  const auto weighted = triangulation.geom_traits().construct_weighted_point_3_object();
  for (const auto& faces : parts) {
    const std::size_t count = std::min(most_points, faces.size());
    for (std::size_t k = 0; k < count; ++k) {
      const auto h = surface.halfedge(faces[k * faces.size() / count]);
      const auto &a = surface.point(surface.source(h)), &b = surface.point(surface.target(h)),
                 &c = surface.point(surface.target(surface.next(h)));
      const Kernel::Point_3 middle = CGAL::centroid(a, b, c);
      const Kernel::Vector_3 normal = CGAL::cross_product(b - a, c - a);
      const double length = std::sqrt(normal.squared_length());
      if (!(length > 0.0)) continue;
      const Kernel::Vector_3 step = 1e-3 / std::sqrt(length) * normal;  // 1e-3 of the triangle's own size
      const auto found = intersection(Kernel::Segment_3(middle - step, middle + step));
      if (std::get<2>(found) == 0) continue;
      const auto vertex = triangulation.insert(weighted(std::get<0>(found)));
      if (vertex == Complex::Vertex_handle()) continue;  // within the ball of a sharp edge
      if (complex.in_dimension(vertex) < 2 && complex.in_dimension(vertex) >= 0) continue;
      complex.set_dimension(vertex, 2);
      complex.set_index(vertex, std::get<1>(found));
    }
  }
}

struct Mesh {
  MeshData<3> data;
  std::vector<char> is_corner;  ///< by vertex: one where sharp edges meet
  std::vector<double> areas;    ///< of the groups, which have no names yet
};
Mesh mesh_of(const Complex& complex) {
  MeshData<3> mesh;
  std::vector<char> is_corner;
  const auto& triangulation = complex.triangulation();
  std::unordered_map<Complex::Vertex_handle, Index> number;
  std::vector<Vec<3>> points;
  mesh.cells.resize(4, static_cast<Eigen::Index>(complex.number_of_cells_in_complex()));
  Index count = 0;
  for (auto c = complex.cells_in_complex_begin(); c != complex.cells_in_complex_end(); ++c, ++count)
    for (int i = 0; i < 4; ++i) {
      const auto [at, is_new] = number.emplace(c->vertex(i), static_cast<Index>(points.size()));
      if (is_new) {
        const auto& p = triangulation.point(c->vertex(i)).point();
        points.emplace_back(p.x(), p.y(), p.z());
        is_corner.push_back(complex.in_dimension(c->vertex(i)) == 0);
      }
      mesh.cells(i, count) = at->second;
    }
  mesh.vertices.resize(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t v = 0; v < points.size(); ++v) mesh.vertices.col(static_cast<Eigen::Index>(v)) = points[v];

  struct Patch {
    double area = 0.0;
    std::vector<std::array<Index, 3>> facets;
  };
  std::map<Domain::Surface_patch_index, Patch> patches;
  for (auto f = complex.facets_in_complex_begin(); f != complex.facets_in_complex_end(); ++f) {
    // Beside flat cells, and where the body is thinner than the mesh resolves, facets may have cells on both sides or
    // on neither.
    if (complex.is_in_complex(f->first) == complex.is_in_complex(f->first->neighbor(f->second))) continue;
    std::array<Index, 3> facet;
    for (int k = 0; k < 3; ++k) facet[k] = number.at(f->first->vertex((f->second + 1 + k) % 4));
    Patch& patch = patches[complex.surface_patch_index(*f)];
    patch.area += 0.5 * (points[facet[1]] - points[facet[0]]).cross(points[facet[2]] - points[facet[0]]).norm();
    patch.facets.push_back(facet);
  }
  std::vector<double> areas;
  for (auto& [index, patch] : patches) {
    mesh.groups.push_back({"", std::move(patch.facets)});
    areas.push_back(patch.area);
  }
  return {std::move(mesh), std::move(is_corner), std::move(areas)};
}

/// Meshes side by side as one.
Mesh together(std::vector<Mesh> bodies) {
  if (bodies.size() == 1) return std::move(bodies.front());
  Eigen::Index vertices = 0, cells = 0;
  for (const Mesh& body : bodies) {
    vertices += body.data.vertices.cols();
    cells += body.data.cells.cols();
  }
  Mesh all;
  all.data.vertices.resize(3, vertices);
  all.data.cells.resize(4, cells);
  vertices = cells = 0;
  for (Mesh& body : bodies) {
    const auto first = static_cast<Index>(vertices);
    all.data.vertices.middleCols(vertices, body.data.vertices.cols()) = body.data.vertices;
    all.data.cells.middleCols(cells, body.data.cells.cols()) = body.data.cells.array() + first;
    vertices += body.data.vertices.cols();
    cells += body.data.cells.cols();
    for (auto& group : body.data.groups) {
      for (auto& facet : group.facets)
        for (Index& v : facet) v += first;
      all.data.groups.push_back(std::move(group));
    }
    all.areas.insert(all.areas.end(), body.areas.begin(), body.areas.end());
  }
  return all;
}

/// Names the groups "surface 1", "surface 2", ..., the largest first.
void name_groups(Mesh& mesh) {
  std::vector<std::size_t> order(mesh.areas.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::ranges::greater{}, [&](std::size_t g) { return mesh.areas[g]; });
  std::vector<MeshData<3>::Group> groups;
  for (const std::size_t g : order)
    groups.push_back({fmt::format("surface {}", groups.size() + 1), std::move(mesh.data.groups[g].facets)});
  mesh.data.groups = std::move(groups);
}

/// The mesh of one body, of which there may be none left if it is small.
Mesh mesh_body(Surface& surface, const SurfaceMeshOptions& options) {
  const double size = options.size;
  auto part_of = surface.add_property_map<Surface::Face_index, std::size_t>("f:part", 0).first;
  CGAL::Polygon_mesh_processing::connected_components(surface, part_of);

  const double distance = options.distance > 0.0 ? options.distance : size / 20.0;
  mark_sharp_edges(surface, options.feature_angle, distance, size);
  CGAL::Random random(0);
  Domain domain(surface, &random);
  add_curves(surface, domain);
  // Radii of the circumscribed circles and balls, of which an edge of an equilateral triangle is 1.73 and of a regular
  // tetrahedron 1.63 times longer.
  const Criteria criteria(CGAL::parameters::edge_size = size, CGAL::parameters::facet_angle = 20.0,
                          CGAL::parameters::facet_size = 0.6 * size, CGAL::parameters::facet_distance = distance,
                          CGAL::parameters::cell_radius_edge_ratio = 3.0, CGAL::parameters::cell_size = 0.65 * size);
  Complex complex;
  CGAL::Mesh_3::internal::init_c3t3_with_features(complex, domain, criteria);
  insert_initial_points(surface, domain, complex);
  namespace par = CGAL::parameters;
  CGAL::refine_mesh_3(complex, domain, criteria, par::no_lloyd(), par::no_odt(), par::no_perturb(),
                      par::exude(par::sliver_bound = 3.0), par::no_reset_c3t3());
  if (complex.number_of_cells_in_complex() == 0) return {};
  Mesh mesh = mesh_of(complex);
  complex.clear();
  // Exudation moves no point of a flat side, nor where all four are of the boundary.
  internal::peel_flat_cells(mesh.data);
  internal::inflate_flat_cells(mesh.data, 0.1 * distance, mesh.is_corner);
  return mesh;
}

/// Says why the tetrahedra do not fill the volume enclosed, and what to do about it.
std::string too_coarse(double filled, double enclosed, const SurfaceMeshOptions& options) {
  const bool of_distance = options.distance > 0.0;
  return fmt::format(
      "the tetrahedra fill {:.4g} of a volume of {:.4g}: a mesh size of {:g}{} is too coarse for the "
      "body, {}; take {}",
      filled, enclosed, options.size, of_distance ? fmt::format(" with a distance of {:g}", options.distance) : "",
      filled < enclosed ? "whose thin parts or small radii are lost" : "whose cavities are lost",
      of_distance ? "smaller ones" : "a smaller one");
}

}  // namespace

MeshData<3> mesh_surface(const SurfaceSoup& soup, const SurfaceMeshOptions& options) {
  const double size = options.size;
  if (!(size > 0.0)) throw InputError(fmt::format("surface: size is {}, expected a positive length", size));
  if (!(options.feature_angle > 0.0 && options.feature_angle <= 180.0))
    throw InputError(fmt::format("surface: the feature angle is {}, expected 0 to 180 degrees", options.feature_angle));
  if (!(options.distance >= 0.0))
    throw InputError(
        fmt::format("surface: the distance is {}, expected a positive length, or 0 for size / 20", options.distance));
  Surface surface = internal::closed_surface<Surface>(soup);
  const Vec<3> extent = soup.points.rowwise().maxCoeff() - soup.points.rowwise().minCoeff();
  if (constexpr double most = 2e3; extent.maxCoeff() > most * size)
    throw InputError(fmt::format("surface: mesh size {:g} is too small for a body {:g} wide; expected at least {:g}",
                                 size, extent.maxCoeff(), extent.maxCoeff() / most));
  // About 12 tetrahedra of 1000 bytes, of CGAL's and of the mesh together, to a cube of that size.
  const double enclosed = std::abs(CGAL::to_double(CGAL::Polygon_mesh_processing::volume(surface)));
  require_memory(12e3 * enclosed / std::pow(size, 3), fmt::format("surface: a mesh of size {:g}", size),
                 "use a larger size");
  // Bodies one by one: no gap between them is so narrow that it could be closed, or cost more cells than a wide one.
  std::vector<Mesh> bodies;
  for (Surface& body : internal::separate_bodies(surface)) {
    internal::refuse_costly_gaps(internal::soup_of(body), enclosed, options);
    bodies.push_back(mesh_body(body, options));
  }
  Mesh all = together(std::move(bodies));
  if (all.data.cells.cols() == 0) throw InputError(fmt::format("surface: {}", too_coarse(0.0, enclosed, options)));
  name_groups(all);
  MeshData<3> mesh = std::move(all.data);
  const FineMesh<3> body(mesh);
  constexpr double most_lost = 0.1;
  if (const double filled = body.volumes().sum(); std::abs(filled - enclosed) > most_lost * enclosed)
    throw InputError(fmt::format("surface: {}", too_coarse(filled, enclosed, options)));
  // Vertices and edges in which parts of the body only touch are given to each part.
  std::vector<std::array<Index, 3>> boundary;
  for (const auto facet : body.facets().colwise()) boundary.push_back({facet[0], facet[1], facet[2]});
  return in_spatial_order<3>(split_long_edges<3>(cut_open<3>(std::move(mesh), boundary), size));
}

}  // namespace efree
