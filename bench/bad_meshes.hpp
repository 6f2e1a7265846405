// SPDX-License-Identifier: GPL-3.0-or-later
/// Meshes that finite elements would not like; tests and the study share them.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"
#include "efree/tests/bodies.hpp"

#include <random>
#include <string>

namespace efree::bench {

/// The mesh with its inner vertices moved by up to 0.45 edges, as far as no cell turns over.
inline FineMesh<2> jittered(const FineMesh<2>& mesh, double size, unsigned seed = 1) {
  MeshData<2> data{mesh.vertices(), mesh.cells(), {}};
  std::vector<char> fixed(mesh.num_vertices(), 0);
  for (Index f = 0; f < mesh.num_facets(); ++f)
    for (int k = 0; k < 2; ++k) fixed[mesh.facets()(k, f)] = 1;
  std::vector<std::vector<Index>> around(mesh.num_vertices());
  for (Index c = 0; c < mesh.num_cells(); ++c)
    for (int k = 0; k < 3; ++k) around[mesh.cells()(k, c)].push_back(c);
  const auto area = [&](Index c) {
    const Vec<2> a = data.vertices.col(data.cells(0, c)), b = data.vertices.col(data.cells(1, c)),
                 d = data.vertices.col(data.cells(2, c));
    return (b - a).x() * (d - a).y() - (b - a).y() * (d - a).x();
  };
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-0.45 * size, 0.45 * size);
  for (Index v = 0; v < mesh.num_vertices(); ++v) {
    if (fixed[v]) continue;
    const Vec<2> before = data.vertices.col(v);
    const double up = uniform(random), along = uniform(random);  // arguments are evaluated in any order
    data.vertices.col(v) += Vec<2>(along, up);
    for (const Index c : around[v])
      if (!(area(c) > 1e-6 * size * size)) data.vertices.col(v) = before;
  }
  for (const auto& group : mesh.groups()) {
    data.groups.push_back({group.name, {}});
    for (const Index f : group.facets) data.groups.back().facets.push_back({mesh.facets()(0, f), mesh.facets()(1, f)});
  }
  return FineMesh<2>(data);
}

/// "regular"; "jittered"; "slivers", cells as flat as 0.1 degrees; "needles", four times as long as wide, along a
/// diagonal of the plane.
inline FineMesh<2> careless(const std::string& how, const PlanarDomain& domain, double size) {
  if (how == "needles") {
    const double c = std::cos(0.6), s = std::sin(0.6), along = 2.0, across = 0.5;
    const Mat<2> turn{{c, s}, {-s, c}}, flat = Vec<2>(1.0 / along, 1.0 / across).asDiagonal() * turn;
    PlanarDomain squeezed = domain;
    for (auto& line : squeezed.boundary)
      for (auto& x : line.points) x = flat * x;
    const FineMesh<2> mesh = triangulate(squeezed, {.size = size});
    MeshData<2> data{flat.inverse() * mesh.vertices(), mesh.cells(), {}};
    for (const auto& group : mesh.groups()) {
      data.groups.push_back({group.name, {}});
      for (const Index f : group.facets)
        data.groups.back().facets.push_back({mesh.facets()(0, f), mesh.facets()(1, f)});
    }
    return FineMesh<2>(data);
  }
  FineMesh<2> mesh = triangulate(domain, {.size = size});
  if (how == "jittered") return jittered(mesh, size);
  if (how == "slivers") return testing::with_split_cells(mesh, 0.003);
  return mesh;
}

}  // namespace efree::bench
