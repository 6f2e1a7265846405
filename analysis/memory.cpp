// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/analysis/internal/memory.hpp"

#include <algorithm>
#include <cmath>

namespace efree::internal {

template <int Dim> double least_memory(const ApproximationOptions& asked, const FineMesh<Dim>& mesh) {
  constexpr double entry = sizeof(double) + sizeof(Index);
  const double vertices = mesh.num_vertices(), cells = mesh.num_cells();
  const double edges = Dim == 2 ? 1.5 * cells : 1.2 * cells;
  if (asked.kind != BasisKind::mls) {
    const bool linear = asked.kind == BasisKind::p1;
    const double nodes = linear ? vertices : vertices + edges;
    const double coupled = Dim == 2 ? (linear ? 7.0 : 11.5) : (linear ? 15.0 : 28.0);
    return 0.5 * Dim * Dim * coupled * nodes * entry;
  }
  // Volume to a node, and nodes in a support, of a random packing; see sample_cloud.
  const double packing = Dim == 2 ? 1.436 : 1.363, ball = Dim == 2 ? 3.14 : 4.19;
  const double nodes = mesh.volumes().sum() / (packing * std::pow(asked.spacing, Dim));
  const ApproximationOptions options = with_defaults<Dim>(asked, vertices / nodes);
  const double seen = std::min(nodes, ball / packing * std::pow(options.support, Dim));
  const double coupled = std::min(nodes, std::pow(2.0, Dim) * seen);
  const double points = options.interpolation == 2 ? vertices + edges : vertices;
  return entry * (points * seen + 0.5 * Dim * Dim * nodes * coupled);
}

template double least_memory<2>(const ApproximationOptions&, const FineMesh<2>&);
template double least_memory<3>(const ApproximationOptions&, const FineMesh<3>&);

}  // namespace efree::internal
