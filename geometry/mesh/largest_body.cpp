// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/largest_body.hpp"

#include "efree/core/error.hpp"
#include "efree/geometry/mesh/internal/bodies.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace efree {

template <int Dim> LargestMesh<Dim> keep_largest(MeshData<Dim> mesh) {
  const auto count = static_cast<Index>(mesh.cells.cols());
  if (count == 0) throw InputError("mesh: there is no cell");
  if (mesh.cells.minCoeff() < 0 || mesh.cells.maxCoeff() >= mesh.vertices.cols())
    throw InputError("mesh: a cell names a vertex that there is not");
  const std::vector<Index> body = internal::first_of_body<Dim>(mesh.cells, static_cast<Index>(mesh.vertices.cols()));
  std::vector<double> volume(mesh.vertices.cols(), 0.0);  // by first vertex of the body
  double total = 0.0;
  for (Index c = 0; c < count; ++c) {
    Mat<Dim> edges;
    for (int k = 0; k < Dim; ++k)
      edges.col(k) = mesh.vertices.col(mesh.cells(k + 1, c)) - mesh.vertices.col(mesh.cells(0, c));
    const double cell = std::abs(edges.determinant());
    volume[body[mesh.cells(0, c)]] += cell;
    total += cell;
  }
  const auto largest = static_cast<Index>(std::max_element(volume.begin(), volume.end()) - volume.begin());
  LargestMesh<Dim> out;
  out.islands = static_cast<Index>(std::ranges::count_if(volume, [](double v) { return v > 0.0; })) - 1;
  out.fraction = 1.0 - volume[largest] / total;
  if (out.islands > 0) {
    std::vector<Index> kept;
    for (Index c = 0; c < count; ++c)
      if (body[mesh.cells(0, c)] == largest) kept.push_back(c);
    mesh.cells = Cells<Dim>(mesh.cells(Eigen::all, kept));
    if (!mesh.regions.empty()) {
      for (std::size_t k = 0; k < kept.size(); ++k) mesh.regions[k] = mesh.regions[kept[k]];
      mesh.regions.resize(kept.size());
    }
    for (auto& group : mesh.groups)
      std::erase_if(group.facets, [&](const auto& facet) { return body[facet[0]] != largest; });
  }
  out.mesh = std::move(mesh);
  return out;
}

template LargestMesh<2> keep_largest<2>(MeshData<2>);
template LargestMesh<3> keep_largest<3>(MeshData<3>);

}  // namespace efree
