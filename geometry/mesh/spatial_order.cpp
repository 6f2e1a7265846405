// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/spatial_order.hpp"

#include "efree/geometry/mesh/internal/spatial_order.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Spatial_sort_traits_adapter_2.h>
#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/hilbert_sort.h>
#include <CGAL/property_map.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <vector>

namespace efree {

template <int Dim> std::vector<std::size_t> internal::along_curve(const Points<Dim>& vertices) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  std::vector<std::size_t> order(vertices.cols());
  std::iota(order.begin(), order.end(), 0);
  const auto sort = [&]<class Point, template <class, class> class Traits>(std::vector<Point> points) {
    using Map = typename CGAL::Pointer_property_map<Point>::type;
    CGAL::hilbert_sort(order.begin(), order.end(), Traits<Kernel, Map>(CGAL::make_property_map(points)));
  };
  if constexpr (Dim == 2) {
    std::vector<Kernel::Point_2> points;
    for (const auto& x : vertices.colwise()) points.emplace_back(x[0], x[1]);
    sort.template operator()<Kernel::Point_2, CGAL::Spatial_sort_traits_adapter_2>(std::move(points));
  } else {
    std::vector<Kernel::Point_3> points;
    for (const auto& x : vertices.colwise()) points.emplace_back(x[0], x[1], x[2]);
    sort.template operator()<Kernel::Point_3, CGAL::Spatial_sort_traits_adapter_3>(std::move(points));
  }
  return order;
}

template <int Dim> MeshData<Dim> in_spatial_order(MeshData<Dim> mesh) {
  const std::vector<std::size_t> order = internal::along_curve<Dim>(mesh.vertices);
  std::vector<Index> number(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) number[order[k]] = static_cast<Index>(k);
  mesh.vertices = Points<Dim>(mesh.vertices(Eigen::all, order));
  for (auto& group : mesh.groups)
    for (auto& facet : group.facets)
      for (Index& v : facet) v = number[v];
  struct Cell {
    std::array<Index, Dim + 1> vertices;
    Index region;
    bool operator<(const Cell& other) const { return vertices < other.vertices; }
  };
  std::vector<Cell> cells(mesh.cells.cols());
  for (Index c = 0; c < std::ssize(cells); ++c) {
    auto& [vertices, region] = cells[c];
    for (int i = 0; i <= Dim; ++i) vertices[i] = number[mesh.cells(i, c)];
    // The smallest number to the front, and two others the other way round: the same orientation.
    if (const auto least = std::ranges::min_element(vertices); least != vertices.begin()) {
      std::iter_swap(vertices.begin(), least);
      std::swap(vertices[Dim - 1], vertices[Dim]);
    }
    region = mesh.regions.empty() ? 0 : mesh.regions[c];
  }
  std::sort(cells.begin(), cells.end());
  for (Index c = 0; c < std::ssize(cells); ++c) {
    for (int i = 0; i <= Dim; ++i) mesh.cells(i, c) = cells[c].vertices[i];
    if (!mesh.regions.empty()) mesh.regions[c] = cells[c].region;
  }
  return mesh;
}

template std::vector<std::size_t> internal::along_curve<2>(const Points<2>&);
template std::vector<std::size_t> internal::along_curve<3>(const Points<3>&);
template MeshData<2> in_spatial_order<2>(MeshData<2>);
template MeshData<3> in_spatial_order<3>(MeshData<3>);

}  // namespace efree
