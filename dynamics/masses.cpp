// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/masses.hpp"

#include "efree/core/error.hpp"

#include <fmt/ranges.h>

namespace efree {

template <int Dim> void sum_lumped_masses(World<Dim>& world) {
  world.nodes.mass.setZero(world.nodes.size());
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p)) world.nodes.mass[a] += chunk.matter.mass[p] * entry.N;
}

template <int Dim> void sum_added_masses(World<Dim>& world) {
  world.nodes.added_mass.setZero(world.nodes.size());
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p))
        world.nodes.added_mass[a] += chunk.matter.added_mass[p] * entry.N;
}

template <int Dim> void require_masses(const World<Dim>& world) {
  for (Index b = 0; b < world.num_bodies(); ++b)
    for (const Index a : world.nodes_of(b))
      if (!(world.nodes.mass[a] > 0.0))
        throw NumericalError(
            fmt::format("node {} of body {} at ({:.6g}) has no mass: no material point is near it, or shape functions "
                        "are negative there; try another spacing or seed of the nodes",
                        a - world.first_node[b], b, fmt::join(world.nodes.x.col(a), ", ")));
}

template <int Dim> void find_velocities(const World<Dim>& world, const Points<Dim>& impulses, Points<Dim>& velocities) {
  const Nodes<Dim>& nodes = world.nodes;
  const Index N = nodes.size();
  velocities.resize(Dim, N);
  parallel_for(N, [&](Index a) {
    if (nodes.mass[a] > 0.0)
      velocities.col(a) = impulses.col(a) / nodes.mass[a];
    else
      velocities.col(a).setZero();
  });
  const ConsistentMass<Dim>& consistent = world.consistent_mass;
  if (!consistent.any()) return;
  const Index terms = *std::ranges::max_element(consistent.terms);
  Points<Dim> before;
  for (Index k = 1; k < terms; ++k) {
    before = nodes.free.cwiseProduct(velocities);
    parallel_for(N, [&](Index a) {
      if (consistent.terms[nodes.body[a]] <= k) return;
      const Vec<Dim> rest =
          consistent.free_sum.col(a).cwiseProduct(velocities.col(a)) - row_times<Dim>(consistent.coupling, a, before);
      velocities.col(a) = (impulses.col(a) + nodes.free.col(a).cwiseProduct(rest)) / nodes.mass[a];
    });
  }
}

template <int Dim> Points<Dim> velocities_of(const World<Dim>& world, const Points<Dim>& impulses) {
  Points<Dim> velocities;
  find_velocities(world, impulses, velocities);
  return velocities;
}

template <int Dim> void find_momenta(World<Dim>& world) {
  Nodes<Dim>& nodes = world.nodes;
  if (!world.consistent_mass.any()) return;
  nodes.momentum = nodes.v * nodes.mass.asDiagonal();
  Points<Dim> residual = nodes.v - velocities_of(world, nodes.momentum), direction = residual * nodes.mass.asDiagonal(),
              weighted = direction;
  const double enough = 1e-30 * nodes.v.cwiseProduct(nodes.momentum).sum();
  double size = residual.cwiseProduct(weighted).sum();
  for (int k = 0; k < 100 && size > enough; ++k) {
    const Points<Dim> change = velocities_of(world, direction);
    const double length = size / direction.cwiseProduct(change).sum();
    nodes.momentum += length * direction;
    residual -= length * change;
    weighted = residual * nodes.mass.asDiagonal();
    const double next = residual.cwiseProduct(weighted).sum();
    direction = weighted + next / size * direction;
    size = next;
  }
}

#define EFREE_INSTANTIATE(Dim)                                                        \
  template void sum_lumped_masses(World<Dim>&);                                       \
  template void sum_added_masses(World<Dim>&);                                        \
  template void require_masses(const World<Dim>&);                                    \
  template void find_velocities(const World<Dim>&, const Points<Dim>&, Points<Dim>&); \
  template Points<Dim> velocities_of(const World<Dim>&, const Points<Dim>&);          \
  template void find_momenta(World<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree
