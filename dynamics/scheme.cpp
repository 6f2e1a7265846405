// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/scheme.hpp"

#include "efree/dynamics/internal/kernels.hpp"
#include "efree/dynamics/points.hpp"
#include "efree/geometry/cracks/internal/skeleton.hpp"

#include <fmt/ranges.h>
#include <map>
#include <set>

namespace efree {

template <int Dim> void Scheme<Dim>::find_masses(World<Dim>&) {
  throw InputError(fmt::format(
      "the method {} takes mass scaling by a factor alone, and in a run that starts from a state the same factor as in "
      "the earlier run (none, if that had none)",
      name()));
}

template <int Dim> StrainBounds Scheme<Dim>::update_points(const World<Dim>& world, Chunk<Dim>& chunk, double least) {
  return deform_by_table(world, chunk, chunk.table, world.nodes.x, least);
}

template <int Dim> void Scheme<Dim>::scatter_forces(const World<Dim>& world, Chunk<Dim>& chunk) {
  scatter_stresses(world, chunk, chunk.matter.F_since);
}
template <int Dim> void Scheme<Dim>::collect_forces(World<Dim>& world) {
  efree::collect_forces(world, world.nodes.force);
}

template <int Dim>
StrainBounds Scheme<Dim>::examine(const World<Dim>& world, Chunk<Dim>& chunk, double /*dt*/, StrainBounds bounds) {
  if (bounds.regular) return bounds;
  const bool breaks = world.bodies[chunk.body].fracture.on();
  double* columns = chunk.columns();
  Matter<Dim>& matter = chunk.matter;
  StrainBounds result;
  for (Index p = 0; p < chunk.size(); ++p) {
    if (chunk.is_eroded(p)) continue;
    double& strain = columns[16 * p + 9];
    if (const double left = columns[16 * p + 10]; left > 0.0) result.shrinkage = std::max(result.shrinkage, 1.0 / left);
    const double J = matter.J_ratio[p];
    if (J <= 0.0 && breaks) {
      // It breaks at the end of the step, and until then is as it was.
      matter.damage[p] = 1.0;
      matter.J_ratio[p] = matter.now.gradient(p).determinant();
      strain = 0.0;
      continue;
    }
    if (!(J > 0.0))
      throw NumericalError(
          fmt::format("at time {:.6g} the material point at ({:.6g}) is inverted (J = {:.3g}): try a smaller step",
                      world.time, fmt::join(matter.x.col(p), ", "), J));
    result.since_table = std::max(result.since_table, strain);
  }
  return result;
}

template <int Dim> Points<Dim> Scheme<Dim>::point_velocities(const World<Dim>& world) const {
  Points<Dim> result = Points<Dim>::Zero(Dim, world.num_points());
  for_each_chunk(world, [&](const Chunk<Dim>& chunk) {
    for (Index p = 0; p < chunk.size(); ++p)
      for (const auto& [a, entry] : chunk.table.row(p))
        result.col(world.point_number(chunk, p)) += entry.N * world.nodes.v.col(a);
  });
  return result;
}

template <int Dim> Facets<Dim> outer_facets(const World<Dim>& world, Index body) {
  const Cells<Dim>& cells = world.bodies[body].cells;
  const Index first_node = world.first_node[body];
  std::map<std::array<Index, Dim>, std::pair<int, std::array<Index, Dim>>> sides;
  for (Index c = 0; c < cells.cols(); ++c) {
    const auto [chunk, p] = world.locate(world.first_point[body] + c);
    const std::set<Index> different(cells.col(c).begin(), cells.col(c).end());
    if (chunk.is_eroded(p) || different.size() <= Dim) continue;  // or collapsed
    for (int side = 0; side <= Dim; ++side) {
      std::array<Index, Dim> facet;
      for (int i = 0; i < Dim; ++i)
        facet[i] = world.nodes.master_of(first_node + cells(internal::facets_of_cell<Dim>[side][i], c));
      std::array<Index, Dim> key = facet;
      std::ranges::sort(key);
      auto& [count, oriented] = sides[key];
      ++count;
      oriented = facet;
    }
  }
  std::erase_if(sides, [&](const auto& side) {
    const auto& [count, facet] = side.second;
    double radius = 0.0;
    for (const Index a : facet) radius = std::max(radius, world.nodes.x(0, a));
    return count > 1 || (world.axisymmetric() && !(radius > 1e-9 * world.nodes.spacing[facet[0]]));
  });
  Facets<Dim> facets(Dim, static_cast<Index>(sides.size()));
  Index f = 0;
  for (const auto& [key, side] : sides)
    facets.col(f++) = Eigen::Map<const Eigen::Vector<Index, Dim>>(side.second.data());
  return facets;
}

template Facets<2> outer_facets(const World<2>&, Index);
template Facets<3> outer_facets(const World<3>&, Index);
template class Scheme<2>;
template class Scheme<3>;

}  // namespace efree
