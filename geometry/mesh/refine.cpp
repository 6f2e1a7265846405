// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/refine.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/mesh/boundary_offsets.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <map>
#include <tuple>
#include <utility>

namespace efree {
namespace {

/// A side of a cell that is too long.
struct LongEdge {
  double squared_length;
  Index a, b;  ///< a < b
  Index cell;
  friend bool operator<(const LongEdge& left, const LongEdge& right) {  // longest first, cells of an edge together
    return std::tuple(-left.squared_length, left.a, left.b, left.cell) <
           std::tuple(-right.squared_length, right.a, right.b, right.cell);
  }
};

template <int Dim> std::vector<LongEdge> long_edges(const MeshData<Dim>& mesh, double longest) {
  std::vector<LongEdge> edges;
  for (Index c = 0; c < mesh.cells.cols(); ++c)
    for (int i = 0; i <= Dim; ++i)
      for (int j = 0; j < i; ++j) {
        const auto [a, b] = std::minmax(mesh.cells(i, c), mesh.cells(j, c));
        const double squared = (mesh.vertices.col(b) - mesh.vertices.col(a)).squaredNorm();
        if (squared > longest * longest) edges.push_back({squared, a, b, c});
      }
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// Offsets by their points, as edges are split.
template <int Dim> class SplitOffsets {
 public:
  explicit SplitOffsets(const BoundaryOffsets<Dim>& boundary) {
    for (Index k = 0; k < boundary.points.cols(); ++k) set(boundary.points.col(k), boundary.offsets.col(k));
  }
  BoundaryOffsets<Dim> offsets() const {
    const auto count = static_cast<Index>(of_.size());
    BoundaryOffsets<Dim> out{Points<Dim>(Dim, count), Points<Dim>(Dim, count)};
    Index k = 0;
    for (const auto& [point, offset] : of_) {
      out.points.col(k) = Eigen::Map<const Vec<Dim>>(point.data());
      out.offsets.col(k++) = offset;
    }
    return out;
  }
  void split_edge(const Vec<Dim>& a, const Vec<Dim>& b, const Vec<Dim>& middle) {
    if (of_.empty()) return;
    const Vec<Dim> at_a = at(a), at_b = at(b), at_middle = at(edge_midpoint<Dim>(a, b));
    set(middle, at_middle);
    set(edge_midpoint<Dim>(a, middle), 0.375 * at_a - 0.125 * at_b + 0.75 * at_middle);
    set(edge_midpoint<Dim>(middle, b), 0.375 * at_b - 0.125 * at_a + 0.75 * at_middle);
  }
  /// The edge from the middle of ab to the third vertex of a triangle.
  void split_facet(const Vec<Dim>& a, const Vec<Dim>& b, const Vec<Dim>& c, const Vec<Dim>& middle) {
    if (of_.empty()) return;
    set(edge_midpoint<Dim>(middle, c), -0.125 * (at(a) + at(b)) + 0.25 * at(edge_midpoint<Dim>(a, b)) +
                                           0.5 * (at(edge_midpoint<Dim>(a, c)) + at(edge_midpoint<Dim>(b, c))));
  }

 private:
  using Key = std::array<double, Dim>;
  static Key key(const Vec<Dim>& x) {
    Key out;
    std::copy_n(x.data(), Dim, out.begin());
    return out;
  }
  Vec<Dim> at(const Vec<Dim>& x) const {
    const auto found = of_.find(key(x));
    return found == of_.end() ? Vec<Dim>(Vec<Dim>::Zero()) : found->second;
  }
  void set(const Vec<Dim>& x, const Vec<Dim>& offset) {
    if (!offset.isZero(0.0)) of_[key(x)] = offset;
  }

  std::map<Key, Vec<Dim>> of_;
};

template <int Dim> MeshData<Dim> split(MeshData<Dim> mesh, double longest, SplitOffsets<Dim>& offsets) {
  if (!(longest > 0.0))
    throw InputError(fmt::format("split: the longest edge is {}, expected a positive length", longest));
  for (const Index v : mesh.cells.reshaped())
    if (v < 0 || v >= mesh.vertices.cols())
      throw InputError(fmt::format("split: a cell names vertex {}, expected 0 to {}", v, mesh.vertices.cols() - 1));
  // In a pass an edge is split if no cell around it has a longer edge, which makes at most one for each cell and facet.
  for (auto edges = long_edges(mesh, longest); !edges.empty(); edges = long_edges(mesh, longest)) {
    std::vector<char> done(mesh.cells.cols(), 0);
    std::map<std::pair<Index, Index>, Index> middles;
    std::vector<Vec<Dim>> points;
    std::vector<Eigen::Matrix<Index, Dim + 1, 1>> cells;
    const Index first_point = static_cast<Index>(mesh.vertices.cols());
    for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
      const Index a = edges[begin].a, b = edges[begin].b;
      bool is_longest = true;
      for (; end < edges.size() && edges[end].a == a && edges[end].b == b; ++end)
        if (std::exchange(done[edges[end].cell], 1)) is_longest = false;
      if (!is_longest) continue;
      const Index middle = first_point + static_cast<Index>(points.size());
      points.push_back(0.5 * (mesh.vertices.col(a) + mesh.vertices.col(b)));
      middles.emplace(std::pair(a, b), middle);
      offsets.split_edge(mesh.vertices.col(a), mesh.vertices.col(b), points.back());
      for (std::size_t k = begin; k < end; ++k) {
        auto cell = mesh.cells.col(edges[k].cell);
        Eigen::Matrix<Index, Dim + 1, 1> second = cell;
        for (int i = 0; i <= Dim; ++i)
          if (cell[i] == a)
            second[i] = middle;
          else if (cell[i] == b)
            cell[i] = middle;
        cells.push_back(second);
        if (!mesh.regions.empty()) mesh.regions.push_back(mesh.regions[edges[k].cell]);
      }
    }
    mesh.vertices.conservativeResize(Eigen::NoChange, first_point + static_cast<Index>(points.size()));
    for (std::size_t k = 0; k < points.size(); ++k) mesh.vertices.col(first_point + static_cast<Index>(k)) = points[k];
    const Index first_cell = static_cast<Index>(mesh.cells.cols());
    mesh.cells.conservativeResize(Eigen::NoChange, first_cell + static_cast<Index>(cells.size()));
    for (std::size_t k = 0; k < cells.size(); ++k) mesh.cells.col(first_cell + static_cast<Index>(k)) = cells[k];
    for (auto& group : mesh.groups)
      for (std::size_t f = 0, count = group.facets.size(); f < count; ++f) {
        auto& facet = group.facets[f];
        for (int i = 0; i < Dim; ++i)
          for (int j = 0; j < i; ++j)
            if (const auto middle = middles.find(std::minmax({facet[i], facet[j]})); middle != middles.end()) {
              if constexpr (Dim == 3)
                offsets.split_facet(mesh.vertices.col(facet[i]), mesh.vertices.col(facet[j]),
                                    mesh.vertices.col(facet[3 - i - j]), mesh.vertices.col(middle->second));
              auto second = facet;
              second[i] = facet[j] = middle->second;
              group.facets.push_back(second);  // may move `facet`
              i = Dim;
              break;
            }
      }
  }
  return mesh;
}

}  // namespace

template <int Dim> MeshData<Dim> split_long_edges(MeshData<Dim> mesh, double longest) {
  SplitOffsets<Dim> none({});
  return split<Dim>(std::move(mesh), longest, none);
}

template <int Dim> CurvedMesh<Dim> split_long_edges(CurvedMesh<Dim> curved, double longest) {
  SplitOffsets<Dim> offsets(curved.boundary);
  curved.mesh = split<Dim>(std::move(curved.mesh), longest, offsets);
  curved.boundary = offsets.offsets();
  return curved;
}

template MeshData<2> split_long_edges<2>(MeshData<2>, double);
template MeshData<3> split_long_edges<3>(MeshData<3>, double);
template CurvedMesh<2> split_long_edges<2>(CurvedMesh<2>, double);
template CurvedMesh<3> split_long_edges<3>(CurvedMesh<3>, double);

}  // namespace efree
