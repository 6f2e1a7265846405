// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/largest_body.hpp"

#include "efree/core/error.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {

template <int Dim> LargestMesh<Dim> keep_largest(MeshData<Dim> mesh) {
  const auto count = static_cast<Index>(mesh.cells.cols());
  if (count == 0) throw InputError("mesh: there is no cell");
  if (mesh.cells.minCoeff() < 0 || mesh.cells.maxCoeff() >= mesh.vertices.cols())
    throw InputError("mesh: a cell names a vertex that there is not");
  // Trees of vertices; the root is the smallest of its body.
  std::vector<Index> parent(mesh.vertices.cols());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](Index v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (Index c = 0; c < count; ++c)
    for (int i = 1; i <= Dim; ++i) {
      const auto [low, high] = std::minmax({root(mesh.cells(0, c)), root(mesh.cells(i, c))});  // values, not references
      parent[high] = low;
    }
  std::vector<double> volume(mesh.vertices.cols(), 0.0);  // by root
  double total = 0.0;
  for (Index c = 0; c < count; ++c) {
    Mat<Dim> edges;
    for (int k = 0; k < Dim; ++k)
      edges.col(k) = mesh.vertices.col(mesh.cells(k + 1, c)) - mesh.vertices.col(mesh.cells(0, c));
    const double cell = std::abs(edges.determinant());
    volume[root(mesh.cells(0, c))] += cell;
    total += cell;
  }
  const auto largest = static_cast<Index>(std::max_element(volume.begin(), volume.end()) - volume.begin());
  LargestMesh<Dim> out;
  out.islands = static_cast<Index>(std::ranges::count_if(volume, [](double v) { return v > 0.0; })) - 1;
  out.fraction = 1.0 - volume[largest] / total;
  if (out.islands > 0) {
    std::vector<Index> kept;
    for (Index c = 0; c < count; ++c)
      if (root(mesh.cells(0, c)) == largest) kept.push_back(c);
    mesh.cells = Cells<Dim>(mesh.cells(Eigen::all, kept));
    if (!mesh.regions.empty()) {
      for (std::size_t k = 0; k < kept.size(); ++k) mesh.regions[k] = mesh.regions[kept[k]];
      mesh.regions.resize(kept.size());
    }
    for (auto& group : mesh.groups)
      std::erase_if(group.facets, [&](const auto& facet) { return root(facet[0]) != largest; });
  }
  out.mesh = std::move(mesh);
  return out;
}

template LargestMesh<2> keep_largest<2>(MeshData<2>);
template LargestMesh<3> keep_largest<3>(MeshData<3>);

}  // namespace efree
