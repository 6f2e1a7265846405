// SPDX-License-Identifier: GPL-3.0-or-later
/// Finer meshes of the same polygons.
#pragma once

#include "efree/geometry/mesh/fine_mesh.hpp"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

namespace efree::bench {

/// Every cell cut into 2^Dim at the middles of its edges (Bey 1995). Groups and regions follow.
template <int Dim> FineMesh<Dim> refined(const FineMesh<Dim>& mesh) {
  MeshData<Dim> data{mesh.vertices(), {}, {}};
  std::map<std::pair<Index, Index>, Index> middles;
  std::vector<Vec<Dim>> added;
  const auto middle = [&](Index a, Index b) {
    const auto [place, is_new] = middles.try_emplace(std::minmax(a, b), mesh.num_vertices() + added.size());
    if (is_new) added.push_back(0.5 * (mesh.vertex(a) + mesh.vertex(b)));
    return place->second;
  };
  constexpr int parts = 1 << Dim;
  data.cells.resize(Dim + 1, parts * mesh.num_cells());
  for (Index c = 0; c < mesh.num_cells(); ++c) {
    const auto v = mesh.cells().col(c);
    const auto m = [&](int i, int j) { return middle(v[i], v[j]); };
    auto out = data.cells.middleCols(parts * c, parts);
    if constexpr (Dim == 2) {
      out << v[0], v[1], v[2], m(0, 1),  //
          m(0, 1), m(0, 1), m(0, 2), m(1, 2), m(0, 2), m(1, 2), m(1, 2), m(0, 2);
    } else {
      const Index a = m(0, 1), b = m(0, 2), d = m(0, 3), e = m(1, 2), f = m(1, 3), g = m(2, 3);
      out.col(0) << v[0], a, b, d;
      out.col(1) << a, v[1], e, f;
      out.col(2) << b, e, v[2], g;
      out.col(3) << d, f, g, v[3];
      // The octahedron that is left, around the diagonal from b to f.
      out.col(4) << a, b, d, f;
      out.col(5) << a, b, e, f;
      out.col(6) << b, d, f, g;
      out.col(7) << b, e, f, g;
    }
    if (mesh.num_regions() > 1)
      for (int k = 0; k < parts; ++k) data.regions.push_back(mesh.region(c));
  }
  if (mesh.num_regions() > 1) data.region_names = mesh.region_names();
  for (const auto& group : mesh.groups()) {
    data.groups.push_back({group.name, {}});
    for (const Index facet : group.facets) {
      const auto v = mesh.facets().col(facet);
      auto& facets = data.groups.back().facets;
      if constexpr (Dim == 2) {
        const Index m = middle(v[0], v[1]);
        facets.insert(facets.end(), {{v[0], m}, {m, v[1]}});
      } else {
        const Index a = middle(v[0], v[1]), b = middle(v[1], v[2]), d = middle(v[2], v[0]);
        facets.insert(facets.end(), {{v[0], a, d}, {a, v[1], b}, {d, b, v[2]}, {a, b, d}});
      }
    }
  }
  data.vertices.conservativeResize(Dim, mesh.num_vertices() + static_cast<Index>(added.size()));
  for (std::size_t k = 0; k < added.size(); ++k)
    data.vertices.col(mesh.num_vertices() + static_cast<Index>(k)) = added[k];
  return FineMesh<Dim>(data);
}

}  // namespace efree::bench
