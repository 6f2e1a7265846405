// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/mesh/walls.hpp"

#include "efree/core/internal/infinity.hpp"
#include "efree/core/parallel.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace efree {
namespace {

using internal::infinity;

/// Not the middle itself: on regular meshes the way from there runs along edges, and through vertices.
template <int Dim> Vec<Dim> near_middle(const FineMesh<Dim>& mesh, Index f) {
  constexpr std::array<double, 3> planar{0.47, 0.53}, solid{0.31, 0.33, 0.36};
  Vec<Dim> x = Vec<Dim>::Zero();
  for (int k = 0; k < Dim; ++k) x += (Dim == 2 ? planar : solid)[k] * mesh.vertex(mesh.facets()(k, f));
  return x;
}

template <int Dim> double thickness_below(const FineMesh<Dim>& mesh, Index f) {
  const Vec<Dim> start = near_middle(mesh, f), normal = mesh.facet_normal(f);
  Index cell = mesh.facet_cell(f), from = cell;
  // Round-off may send a way that meets an edge around it for ever.
  for (Index steps = 0; steps < mesh.num_cells(); ++steps) {
    const auto slopes = mesh.hat_gradients(cell);
    double nearest = infinity;
    Index exit = -1;
    for (int i = 0; i <= Dim; ++i) {
      const double falls = slopes.col(i).dot(normal);  // the hat, on the way inwards
      if (falls <= 0.0 || mesh.neighbour(i, cell) == from) continue;
      const Vec<Dim> on_side = mesh.vertex(mesh.cells()(i == 0 ? 1 : 0, cell));
      const double length = slopes.col(i).dot(start - on_side) / falls;
      if (length >= nearest) continue;
      nearest = length;
      exit = i;
    }
    if (exit < 0) return infinity;
    const Index next = mesh.neighbour(exit, cell);
    if (next < 0) return slopes.col(exit).normalized().dot(normal) > 0.8 ? nearest : infinity;
    from = cell;
    cell = next;
  }
  return infinity;
}

}  // namespace

template <int Dim> Vector wall_thickness(const FineMesh<Dim>& mesh) {
  Vector thickness(mesh.num_facets());
  parallel_for(mesh.num_facets(), [&](Index f) { thickness[f] = thickness_below(mesh, f); });
  return thickness;
}

template <int Dim> double thin_wall(const FineMesh<Dim>& mesh, double share) {
  const Vector thickness = wall_thickness(mesh);
  std::vector<std::pair<double, double>> walls;
  double total = 0.0, passed = 0.0;
  for (Index f = 0; f < mesh.num_facets(); ++f) {
    if (!std::isfinite(thickness[f])) continue;
    walls.emplace_back(thickness[f], mesh.facet_measure(f));
    total += walls.back().second;
  }
  std::ranges::sort(walls);
  for (const auto& [value, measure] : walls)
    if ((passed += measure) >= share * total) return value;
  return infinity;
}

template double thin_wall<2>(const FineMesh<2>&, double);
template double thin_wall<3>(const FineMesh<3>&, double);
template Vector wall_thickness<2>(const FineMesh<2>&);
template Vector wall_thickness<3>(const FineMesh<3>&);

}  // namespace efree
