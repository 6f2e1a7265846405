// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/boundary_offsets.hpp"

#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"
#include "efree/geometry/mesh/internal/smooth_normals.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

/// Vertices of a facet whose midpoints are its points after its vertices.
template <int Dim> constexpr auto facet_edges() {
  using Ends = std::array<int, 2>;
  if constexpr (Dim == 2)
    return std::array<Ends, 1>{{{0, 1}}};
  else
    return std::array<Ends, 3>{{{0, 1}, {0, 2}, {1, 2}}};
}

template <int Dim> bool is_before(const Vec<Dim>& a, const Vec<Dim>& b) {
  return std::lexicographical_compare(a.data(), a.data() + Dim, b.data(), b.data() + Dim);
}

/// Finds offsets by their points.
template <int Dim> class OffsetFinder {
 public:
  explicit OffsetFinder(const BoundaryOffsets<Dim>& boundary) : boundary_(boundary), order_(boundary.points.cols()) {
    require(boundary.points.cols() == boundary.offsets.cols(), "boundary offsets: one for each point expected");
    std::iota(order_.begin(), order_.end(), 0);
    std::ranges::sort(order_, [&](Index i, Index j) { return is_before(point(i), point(j)); });
  }
  /// The column of the offset, -1 where there is none.
  Index find(const Vec<Dim>& x) const {
    const auto found = std::ranges::lower_bound(
        order_, x, [](const auto& a, const auto& b) { return is_before<Dim>(a, b); },
        [&](Index i) { return point(i); });
    return found == order_.end() || point(*found) != x ? -1 : *found;
  }
  /// Zero where there is none.
  Vec<Dim> at(const Vec<Dim>& x) const {
    const Index column = find(x);
    return column < 0 ? Vec<Dim>::Zero() : Vec<Dim>(boundary_.offsets.col(column));
  }

 private:
  Vec<Dim> point(Index i) const { return boundary_.points.col(i); }

  const BoundaryOffsets<Dim>& boundary_;
  std::vector<Index> order_;
};

}  // namespace

template <int Dim> Matrix facet_offsets(const FineMesh<Dim>& mesh, const BoundaryOffsets<Dim>& boundary) {
  Matrix offsets = Matrix::Zero(Dim * facet_points<Dim>, mesh.num_facets());
  if (boundary.points.cols() == 0) return offsets;
  const OffsetFinder<Dim> find(boundary);
  parallel_for(mesh.num_facets(), [&](Index f) {
    const auto corner = [&](int k) { return mesh.vertex(mesh.facets()(k, f)); };
    int point = 0;
    const auto put = [&](const Vec<Dim>& x) { offsets.col(f).template segment<Dim>(Dim * point++) = find.at(x); };
    for (int k = 0; k < Dim; ++k) put(corner(k));
    for (const auto& [i, j] : facet_edges<Dim>()) put(edge_midpoint<Dim>(corner(i), corner(j)));
  });
  return offsets;
}

template <int Dim> Matrix normal_offsets(const FineMesh<Dim>& mesh, const Matrix& offsets) {
  Matrix heights(facet_points<Dim>, mesh.num_facets());
  for (Index f = 0; f < mesh.num_facets(); ++f)
    heights.col(f) = offsets.col(f).reshaped(Dim, facet_points<Dim>).transpose() * mesh.facet_normal(f);
  return heights;
}

template <int Dim> Vector sagittas(const FineMesh<Dim>& mesh, const Matrix& offsets) {
  return normal_offsets(mesh, offsets).cwiseAbs().colwise().maxCoeff().transpose();
}

template <int Dim> BoundaryOffsets<Dim> smooth_offsets(const FineMesh<Dim>& mesh) {
  const Matrix normals = internal::smooth_normals<Dim>(mesh.vertices(), mesh.facets(), largest_smooth_angle);
  std::vector<Vec<Dim>> points, offsets;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    for (const auto& [i, j] : facet_edges<Dim>()) {
      const Vec<Dim> a = mesh.vertex(mesh.facets()(i, f)), b = mesh.vertex(mesh.facets()(j, f));
      const auto normal = [&](int k) -> Vec<Dim> { return normals.col(f).template segment<Dim>(Dim * k); };
      const Vec<Dim> offset = internal::edge_offset<Dim>(a, b, normal(i), normal(j));
      if (offset.isZero(0.0)) continue;
      points.push_back(edge_midpoint<Dim>(a, b));
      offsets.push_back(offset);
    }
  }
  BoundaryOffsets<Dim> out{Points<Dim>(Dim, std::ssize(points)), Points<Dim>(Dim, std::ssize(points))};
  for (std::size_t k = 0; k < points.size(); ++k) {
    out.points.col(static_cast<Index>(k)) = points[k];
    out.offsets.col(static_cast<Index>(k)) = offsets[k];
  }
  return out;
}

template <int Dim> CurvedMesh<Dim> scaled(CurvedMesh<Dim> curved, double factor) {
  const Points<Dim> before = curved.mesh.vertices;
  Points<Dim>& vertices = curved.mesh.vertices;
  vertices *= factor;
  if (curved.boundary.points.cols() == 0) return curved;
  // Midpoints of edges have to be those of the new vertices to the last digit.
  const BoundaryOffsets<Dim> old = curved.boundary;
  const OffsetFinder<Dim> finder(old);
  for (Index c = 0; c < curved.mesh.cells.cols(); ++c)
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j <= i; ++j) {
        const Index a = curved.mesh.cells(i, c), b = curved.mesh.cells(j, c);
        if (const Index k = finder.find(edge_midpoint<Dim>(before.col(a), before.col(b))); k >= 0)
          curved.boundary.points.col(k) = edge_midpoint<Dim>(vertices.col(a), vertices.col(b));
      }
  curved.boundary.offsets *= factor;
  return curved;
}

template CurvedMesh<2> scaled<2>(CurvedMesh<2>, double);
template CurvedMesh<3> scaled<3>(CurvedMesh<3>, double);
template Matrix facet_offsets<2>(const FineMesh<2>&, const BoundaryOffsets<2>&);
template Matrix facet_offsets<3>(const FineMesh<3>&, const BoundaryOffsets<3>&);
template Matrix normal_offsets<2>(const FineMesh<2>&, const Matrix&);
template Matrix normal_offsets<3>(const FineMesh<3>&, const Matrix&);
template Vector sagittas<2>(const FineMesh<2>&, const Matrix&);
template Vector sagittas<3>(const FineMesh<3>&, const Matrix&);
template BoundaryOffsets<2> smooth_offsets<2>(const FineMesh<2>&);
template BoundaryOffsets<3> smooth_offsets<3>(const FineMesh<3>&);

}  // namespace efree
