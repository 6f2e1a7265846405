// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/heatgeo/patch.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

double cross(const Vec<2>& a, const Vec<2>& b) {
  return a.x() * b.y() - a.y() * b.x();
}

std::vector<Index> all_vertices(const FineMesh<2>& mesh) {
  std::vector<Index> all(mesh.num_vertices());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

}  // namespace

template <int Dim> double length_tolerance(const FineMesh<Dim>& mesh) {
  return 1e-12 * mesh.vertices().cwiseAbs().maxCoeff();
}

bool shows_outer_side(const FineMesh<2>& mesh, Index f, const Vec<2>& source, double tolerance) {
  const Vec<2> a = mesh.vertex(mesh.facets()(0, f)), along = mesh.vertex(mesh.facets()(1, f)) - a,
               to_source = source - a;
  // The body is on the left. A short facet far away magnifies the rounding of its own vertices.
  const double height = cross(along, to_source);
  return height < 0.0 && -height > tolerance * (along.norm() + to_source.norm());
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
  for (int i = 0; i <= Dim; ++i) {
    const Vec<Dim> a = x.col(cell[i]) - centre, along = x.col(cell[(i + 1) % (Dim + 1)]) - centre - a;
    const double t = std::clamp(-a.dot(along) / along.squaredNorm(), 0.0, 1.0);
    if ((a + t * along).squaredNorm() < reach) return true;
  }
  return false;
}

template <int Dim> bool PatchFinder<Dim>::is_obstructed() const {
  const Vec<Dim> source = mesh_.vertex(patch_.source);
  const auto is_twin = [&](Index v) {
    return v != patch_.source && (mesh_.vertex(v) - source).cwiseAbs().maxCoeff() <= tolerance_;
  };
  return std::any_of(patch_.facets.begin(), patch_.facets.end(), [&](Index f) {
    return shows_outer_side(mesh_, f, source, tolerance_) || is_twin(mesh_.facets()(0, f));
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

template class PatchFinder<2>;
template double length_tolerance<2>(const FineMesh<2>&);

VertexGrid::VertexGrid(const FineMesh<2>& mesh) : VertexGrid(mesh, all_vertices(mesh)) {}

VertexGrid::VertexGrid(const FineMesh<2>& mesh, const std::vector<Index>& vertices)
    : origin_(mesh.vertices().rowwise().minCoeff()) {
  constexpr double vertices_per_square = 8.0;
  const Vec<2> extent = mesh.vertices().rowwise().maxCoeff() - origin_;
  width_ = std::sqrt(extent.prod() * vertices_per_square / static_cast<double>(vertices.size()));
  columns_ = static_cast<Index>(extent.x() / width_) + 1;
  rows_ = static_cast<Index>(extent.y() / width_) + 1;

  std::vector<Index> of(vertices.size());
  squares_.offsets.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
  for (std::size_t k = 0; k < vertices.size(); ++k) {
    const auto at = square(mesh.vertex(vertices[k]));
    of[k] = at.y() * columns_ + at.x();
    ++squares_.offsets[of[k] + 1];
  }
  std::partial_sum(squares_.offsets.begin(), squares_.offsets.end(), squares_.offsets.begin());
  squares_.items.resize(vertices.size());
  std::vector<Index> cursor(squares_.offsets.begin(), squares_.offsets.end() - 1);
  for (std::size_t k = 0; k < vertices.size(); ++k)
    squares_.items[cursor[of[k]]++] = {mesh.vertex(vertices[k]), vertices[k]};
}

Eigen::Vector2i VertexGrid::square(const Vec<2>& x) const {
  const Vec<2> at = (x - origin_) / width_;
  return {static_cast<int>(std::clamp(at.x(), 0.0, columns_ - 1.0)),
          static_cast<int>(std::clamp(at.y(), 0.0, rows_ - 1.0))};
}

}  // namespace efree
