// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/cracks/point_mesh.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/facet_samples.hpp"
#include "efree/geometry/mesh/internal/signed_volume.hpp"
#include "efree/geometry/mesh/locator.hpp"

#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace efree {
namespace {

using PointKernel = CGAL::Exact_predicates_inexact_constructions_kernel;

/// A Delaunay triangulation whose vertices know their numbers.
template <int Dim> class Delaunay;

template <> class Delaunay<2> {
 public:
  using Vertex = CGAL::Triangulation_vertex_base_with_info_2<Index, PointKernel>;
  using Triangulation = CGAL::Delaunay_triangulation_2<PointKernel, CGAL::Triangulation_data_structure_2<Vertex>>;
  static Triangulation::Point place(const Vec<2>& x) { return {x[0], x[1]}; }
  static auto edges(const Triangulation& of) { return of.finite_edges(); }
  static auto cells(const Triangulation& of) { return of.finite_face_handles(); }
  static std::pair<Index, Index> ends(const Triangulation::Edge& edge) {
    const auto& [face, opposite] = edge;
    return {face->vertex((opposite + 1) % 3)->info(), face->vertex((opposite + 2) % 3)->info()};
  }
};
template <> class Delaunay<3> {
 public:
  using Vertex = CGAL::Triangulation_vertex_base_with_info_3<Index, PointKernel>;
  using Triangulation = CGAL::Delaunay_triangulation_3<PointKernel, CGAL::Triangulation_data_structure_3<Vertex>>;
  static Triangulation::Point place(const Vec<3>& x) { return {x[0], x[1], x[2]}; }
  static auto edges(const Triangulation& of) { return of.finite_edges(); }
  static auto cells(const Triangulation& of) { return of.finite_cell_handles(); }
  static std::pair<Index, Index> ends(const Triangulation::Edge& edge) {
    const auto& [cell, i, j] = edge;
    return {cell->vertex(i)->info(), cell->vertex(j)->info()};
  }
};

template <int Dim> using Triangulation = typename Delaunay<Dim>::Triangulation;

/// Inserts points with numbers from `first` on.
template <int Dim> void insert(const Points<Dim>& points, Index first, Triangulation<Dim>& into) {
  std::vector<std::pair<typename Triangulation<Dim>::Point, Index>> numbered;
  numbered.reserve(points.cols());
  for (Index p = 0; p < points.cols(); ++p) numbered.emplace_back(Delaunay<Dim>::place(points.col(p)), first + p);
  into.insert(numbered.begin(), numbered.end());
}

/// The distance from a point to the one next to it: the median over all.
template <int Dim> double spacing_of(const Triangulation<Dim>& of, const Points<Dim>& points) {
  std::vector<double> nearest(points.cols(), std::numeric_limits<double>::infinity());
  for (const auto& edge : Delaunay<Dim>::edges(of)) {
    const auto [a, b] = Delaunay<Dim>::ends(edge);
    const double length = (points.col(a) - points.col(b)).norm();
    nearest[a] = std::min(nearest[a], length);
    nearest[b] = std::min(nearest[b], length);
  }
  const auto middle = nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2);
  std::ranges::nth_element(nearest, middle);
  return *middle;
}

template <int Dim> Cells<Dim> all_cells(const Triangulation<Dim>& of) {
  std::vector<std::array<Index, Dim + 1>> found;
  for (const auto cell : Delaunay<Dim>::cells(of)) {
    std::array<Index, Dim + 1>& vertices = found.emplace_back();
    for (int i = 0; i <= Dim; ++i) vertices[i] = cell->vertex(i)->info();
  }
  Cells<Dim> cells(Dim + 1, static_cast<Index>(found.size()));
  for (std::size_t c = 0; c < found.size(); ++c)
    for (int i = 0; i <= Dim; ++i) cells(i, static_cast<Index>(c)) = found[c][i];
  return cells;
}

template <int Dim, class Keep> Cells<Dim> select(const Cells<Dim>& cells, const Keep& keep) {
  std::vector<char> kept(cells.cols());
  parallel_for(static_cast<Index>(cells.cols()), [&](Index c) { kept[c] = keep(c); });
  std::vector<Index> these;
  for (Index c = 0; c < cells.cols(); ++c)
    if (kept[c] != 0) these.push_back(c);
  return cells(Eigen::all, these);
}

template <int Dim> Triangulation<Dim> triangulate(const Points<Dim>& points) {
  require(points.cols() > Dim, "a mesh between points: expected four points, in the plane three, and more");
  Triangulation<Dim> result;
  insert<Dim>(points, 0, result);
  return result;
}

}  // namespace

template <int Dim> PointMesh<Dim> mesh_between(const Points<Dim>& points, const FineMesh<Dim>& body) {
  Triangulation<Dim> triangulation = triangulate<Dim>(points);
  const double spacing = spacing_of<Dim>(triangulation, points);
  const Points<Dim> samples = internal::sample_boundary(body, spacing);

  PointMesh<Dim> mesh;
  mesh.num_points = static_cast<Index>(points.cols());
  mesh.owner.resize(mesh.num_points);
  std::iota(mesh.owner.begin(), mesh.owner.end(), 0);
  std::vector<Index> apart;  // from all points: others are on the surface themselves
  for (Index s = 0; s < samples.cols(); ++s) {
    const Index owner = triangulation.nearest_vertex(Delaunay<Dim>::place(samples.col(s)))->info();
    if ((points.col(owner) - samples.col(s)).norm() < 0.1 * spacing) continue;
    apart.push_back(s);
    mesh.owner.push_back(owner);
  }
  const Points<Dim> surface = samples(Eigen::all, apart);
  mesh.vertices.resize(Dim, points.cols() + surface.cols());
  mesh.vertices << points, surface;
  insert<Dim>(surface, mesh.num_points, triangulation);

  const Cells<Dim> cells = all_cells<Dim>(triangulation);
  const Locator<Dim> locator(body, static_cast<std::size_t>(cells.cols()));
  mesh.cells = select<Dim>(cells, [&](Index c) {
    Vec<Dim> centroid = Vec<Dim>::Zero();
    bool on_surface = true;
    for (int i = 0; i <= Dim; ++i) {
      centroid += mesh.vertices.col(cells(i, c)) / (Dim + 1);
      on_surface &= cells(i, c) >= mesh.num_points;
    }
    // Points of a flat part of the surface, off it by rounding.
    if (on_surface && internal::signed_volume<Dim>(mesh.vertices, cells, c) < 1e-9 * std::pow(spacing, Dim))
      return false;
    return locator.find(centroid).has_value();
  });
  return mesh;
}

template <int Dim> PointMesh<Dim> mesh_between(const Points<Dim>& points) {
  const Triangulation<Dim> triangulation = triangulate<Dim>(points);
  const double longest = 3.0 * spacing_of<Dim>(triangulation, points);
  PointMesh<Dim> mesh{.vertices = points, .num_points = static_cast<Index>(points.cols())};
  mesh.owner.resize(points.cols());
  std::iota(mesh.owner.begin(), mesh.owner.end(), 0);
  const Cells<Dim> cells = all_cells<Dim>(triangulation);
  mesh.cells = select<Dim>(cells, [&](Index c) {
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j)
        if ((points.col(cells(i, c)) - points.col(cells(j, c))).norm() > longest) return false;
    return true;
  });
  return mesh;
}

template <int Dim> PointMesh<Dim> mesh_of_vertices(const FineMesh<Dim>& mesh) {
  PointMesh<Dim> result{.vertices = mesh.vertices(), .cells = mesh.cells(), .num_points = mesh.num_vertices()};
  result.owner.resize(mesh.num_vertices());
  std::iota(result.owner.begin(), result.owner.end(), 0);
  return result;
}

template <int Dim> PointMesh<Dim> join(const std::vector<PointMesh<Dim>>& meshes) {
  PointMesh<Dim> all;
  Index vertices = 0, cells = 0;
  for (const PointMesh<Dim>& mesh : meshes) {
    all.num_points += mesh.num_points;
    vertices += static_cast<Index>(mesh.vertices.cols());
    cells += static_cast<Index>(mesh.cells.cols());
  }
  all.vertices.resize(Dim, vertices);
  all.owner.resize(vertices);
  all.cells.resize(Dim + 1, cells);
  Index point = 0, other = all.num_points, cell = 0;
  for (const PointMesh<Dim>& mesh : meshes) {
    const auto others = static_cast<Index>(mesh.vertices.cols()) - mesh.num_points;
    all.vertices.middleCols(point, mesh.num_points) = mesh.vertices.leftCols(mesh.num_points);
    all.vertices.middleCols(other, others) = mesh.vertices.rightCols(others);
    const auto number = [&](Index v) { return v < mesh.num_points ? point + v : other + v - mesh.num_points; };
    for (Index v = 0; v < mesh.vertices.cols(); ++v) all.owner[number(v)] = number(mesh.owner[v]);
    for (Index c = 0; c < mesh.cells.cols(); ++c, ++cell)
      for (int i = 0; i <= Dim; ++i) all.cells(i, cell) = number(mesh.cells(i, c));
    point += mesh.num_points;
    other += others;
  }
  return all;
}

#define EFREE_INSTANTIATE(Dim)                                                    \
  template PointMesh<Dim> mesh_between(const Points<Dim>&, const FineMesh<Dim>&); \
  template PointMesh<Dim> mesh_between(const Points<Dim>&);                       \
  template PointMesh<Dim> mesh_of_vertices(const FineMesh<Dim>&);                 \
  template PointMesh<Dim> join(const std::vector<PointMesh<Dim>>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
