// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/internal/patch.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

template <int Dim> std::vector<Index> all_vertices(const FineMesh<Dim>& mesh) {
  std::vector<Index> all(mesh.num_vertices());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

/// Whether the origin is nearer than `reach` to the triangle's inside (its edges are tested elsewhere).
bool over_triangle(const Vec<3>& a, const Vec<3>& b, const Vec<3>& c, double reach_squared) {
  const Vec<3> normal = (b - a).cross(c - a);
  const double height = normal.dot(a);
  if (height * height >= reach_squared * normal.squaredNorm()) return false;
  return normal.dot(a.cross(b)) >= 0.0 && normal.dot(b.cross(c)) >= 0.0 && normal.dot(c.cross(a)) >= 0.0;
}

}  // namespace

template <int Dim> double length_tolerance(const FineMesh<Dim>& mesh) {
  return 1e-12 * mesh.vertices().cwiseAbs().maxCoeff();
}

template <int Dim> bool shows_outer_side(const FineMesh<Dim>& mesh, Index f, const Vec<Dim>& source, double tolerance) {
  const auto facet = mesh.facets().col(f);
  const Vec<Dim> a = mesh.vertex(facet[0]), to_source = source - a;
  // A short facet far away magnifies the rounding of its own vertices.
  if constexpr (Dim == 2) {
    const Vec<2> along = mesh.vertex(facet[1]) - a;  // the body is on the left
    const double height = along.x() * to_source.y() - along.y() * to_source.x();
    return height < 0.0 && -height > tolerance * (along.norm() + to_source.norm());
  } else {
    const Vec<3> b = mesh.vertex(facet[1]) - a, c = mesh.vertex(facet[2]) - a;  // b x c points out of the body
    const double height = b.cross(c).dot(to_source), longest = std::max(b.norm(), c.norm());
    return height > 0.0 && height > 4.0 * tolerance * longest * (longest + to_source.norm());
  }
}

template <int Dim> PatchFinder<Dim>::PatchFinder(const FineMesh<Dim>& mesh)
    : mesh_(mesh),
      tolerance_(length_tolerance(mesh)),
      cell_stamp_(mesh.num_cells(), 0),
      vertex_stamp_(mesh.num_vertices(), 0) {}

template <int Dim> bool PatchFinder<Dim>::meets_ball(Index c) const {
  const Vec<Dim> centre = mesh_.vertex(patch_.source);
  const double reach = patch_.radius * patch_.radius;
  const auto& x = mesh_.vertices();
  const auto cell = mesh_.cells().col(c);
  for (int i = 0; i <= Dim; ++i)
    if ((x.col(cell[i]) - centre).squaredNorm() < reach) return true;
  for (int i = 0; i <= Dim; ++i)
    for (int j = 0; j < i; ++j) {
      const Vec<Dim> a = x.col(cell[i]) - centre, along = x.col(cell[j]) - centre - a;
      const double t = std::clamp(-a.dot(along) / along.squaredNorm(), 0.0, 1.0);
      if ((a + t * along).squaredNorm() < reach) return true;
    }
  if constexpr (Dim == 3)
    for (int i = 0; i < 4; ++i)
      if (over_triangle(x.col(cell[(i + 1) % 4]) - centre, x.col(cell[(i + 2) % 4]) - centre,
                        x.col(cell[(i + 3) % 4]) - centre, reach))
        return true;
  return false;
}

template <int Dim> bool PatchFinder<Dim>::is_obstructed() const {
  const Vec<Dim> source = mesh_.vertex(patch_.source);
  const auto is_twin = [&](Index v) {
    return v != patch_.source && (mesh_.vertex(v) - source).cwiseAbs().maxCoeff() <= tolerance_;
  };
  return std::any_of(patch_.facets.begin(), patch_.facets.end(), [&](Index f) {
    return shows_outer_side<Dim>(mesh_, f, source, tolerance_) || is_twin(mesh_.facets()(0, f));
  });
}

template <int Dim> const Patch<Dim>& PatchFinder<Dim>::around(Index source, double radius) {
  ++stamp_;
  patch_.source = source;
  patch_.radius = radius;
  patch_.cells.clear();
  patch_.vertices.clear();
  patch_.distances.clear();
  patch_.facets.clear();
  const Vec<Dim> centre = mesh_.vertex(source);

  const auto add_vertex = [&](Index v) {
    if (vertex_stamp_[v] == stamp_) return;
    vertex_stamp_[v] = stamp_;
    patch_.vertices.push_back(v);
    patch_.distances.push_back((mesh_.vertex(v) - centre).norm());
  };
  const auto try_cell = [&](Index c) {
    if (cell_stamp_[c] == stamp_) return;
    cell_stamp_[c] = stamp_;
    if (!meets_ball(c)) return;
    patch_.cells.push_back(c);
    for (int i = 0; i <= Dim; ++i) add_vertex(mesh_.cells()(i, c));
  };

  add_vertex(source);
  for (Index c : mesh_.cells_of(source)) try_cell(c);
  for (std::size_t k = 0; k < patch_.cells.size(); ++k) {
    const Index c = patch_.cells[k];
    for (Index i = 0; i <= Dim; ++i) {
      const Index next = mesh_.neighbour(i, c);
      if (next >= 0) {
        try_cell(next);
        continue;
      }
      const Index v = mesh_.cells()((i + 1) % (Dim + 1), c);
      for (Index f : mesh_.facets_of(v))
        if (mesh_.facet_cell(f) == c && !(mesh_.facets().col(f).array() == mesh_.cells()(i, c)).any())
          patch_.facets.push_back(f);
    }
  }
  patch_.obstructed = is_obstructed();
  return patch_;
}

template <int Dim> VertexGrid<Dim>::VertexGrid(const FineMesh<Dim>& mesh) : VertexGrid(mesh, all_vertices(mesh)) {}

template <int Dim> VertexGrid<Dim>::VertexGrid(const FineMesh<Dim>& mesh, const std::vector<Index>& vertices)
    : origin_(mesh.vertices().rowwise().minCoeff()) {
  constexpr double vertices_per_square = 8.0;
  const Vec<Dim> extent = mesh.vertices().rowwise().maxCoeff() - origin_;
  width_ = std::pow(extent.prod() * vertices_per_square / static_cast<double>(vertices.size()), 1.0 / Dim);
  count_ = (extent / width_).array().template cast<Index>() + 1;

  std::vector<Index> of(vertices.size());
  squares_.offsets.assign(static_cast<std::size_t>(count_.prod()) + 1, 0);
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    of[k] = number(square(mesh.vertex(vertices[k])));
    ++squares_.offsets[of[k] + 1];
  }
  std::partial_sum(squares_.offsets.begin(), squares_.offsets.end(), squares_.offsets.begin());
  squares_.items.resize(vertices.size());
  std::vector<Index> cursor(squares_.offsets.begin(), squares_.offsets.end() - 1);
  for (std::size_t k = 0; k < vertices.size(); ++k)
    squares_.items[cursor[of[k]]++] = {mesh.vertex(vertices[k]), vertices[k]};
}

template <int Dim> auto VertexGrid<Dim>::square(const Vec<Dim>& x) const -> Square {
  const Eigen::Array<double, Dim, 1> at = (x - origin_) / width_;
  return at.max(0.0).min(count_.template cast<double>() - 1.0).template cast<Index>();
}

template class PatchFinder<2>;
template class PatchFinder<3>;
template double length_tolerance<2>(const FineMesh<2>&);
template double length_tolerance<3>(const FineMesh<3>&);
template bool shows_outer_side<2>(const FineMesh<2>&, Index, const Vec<2>&, double);
template bool shows_outer_side<3>(const FineMesh<3>&, Index, const Vec<3>&, double);
template class VertexGrid<2>;
template class VertexGrid<3>;

}  // namespace efree
