// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/refine.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <algorithm>
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

}  // namespace

template <int Dim> MeshData<Dim> split_long_edges(MeshData<Dim> mesh, double longest) {
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

template MeshData<2> split_long_edges<2>(MeshData<2>, double);
template MeshData<3> split_long_edges<3>(MeshData<3>, double);

}  // namespace efree
