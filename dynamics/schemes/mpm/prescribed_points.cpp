// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/mpm/internal/prescribed_points.hpp"

#include <algorithm>

namespace efree::internal {
namespace {

/// Particles::held of the prescribed velocities (speed) along an axis. held: by point, 1: it has one. varies: with
/// gradients, which gather_held finds.
template <int Dim> void scatter_held(World<Dim>& world, PointGrid<Dim>& grid, const std::vector<char>& held,
                                     const Vector& speed, int axis, bool varies) {
  grid.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    of.held.assign(of.momentum.size(), 0.0);
    const bool has_gradient = varies && of.held_gradient.size() > 0;
    Vector mass = Vector::Zero(of.count());
    Points<Dim> v = Points<Dim>::Zero(Dim, of.count());
    Points<Dim* Dim> motion = Points<Dim * Dim>::Zero(Dim * Dim, has_gradient ? of.count() : 0);
    bool any = false;
    for (Index p = 0; p < chunk.size(); ++p) {
      const Index point = world.point_number(chunk, p);
      if (held[point] == 0) continue;
      of.for_each_share(chunk, p, [&](Index particle, double share) {
        mass[particle] += share;
        v(0, particle) += share * speed[point];
        // At a vertex, not in the middle of the cell.
        const Vec<Dim> apart = of.positions(chunk).col(particle) - chunk.matter.x.col(p);
        for (int j = 0; has_gradient && j < Dim; ++j)
          v(0, particle) += share * of.held_gradient(axis + Dim * j, particle) * apart[j];
      });
      any = true;
    }
    if (!any) return;
    for (Index k = 0; k < of.count(); ++k) {
      if (mass[k] == 0.0) continue;
      v(0, k) /= mass[k];
      for (int j = 0; has_gradient && j < Dim; ++j) motion(Dim * j, k) = of.held_gradient(axis + Dim * j, k);
    }
    double* slots = grid.clear_slots(of);
    scatter(of.count(), of.box,
            {.x = of.positions(chunk).data(),
             .mass = mass.data(),
             .v = v.data(),
             .motion = has_gradient ? motion.data() : nullptr},
            slots);
    grid.take_momenta(of, of.held);
  });
}

/// Gradients of the field that Particles::held makes along an axis. Also of other particles of these chunks, whose
/// gradients mean nothing and are not used.
template <int Dim> void gather_held(World<Dim>& world, PointGrid<Dim>& grid, int axis) {
  Points<Dim> field = Points<Dim>::Zero(Dim, world.nodes.size());
  parallel_for(world.nodes.size(), [&](Index a) {
    const Eigen::Vector4d sum = grid.sum_at_node(world, &Particles<Dim>::held, a);
    if (sum[3] > 0.0) field(0, a) = sum[0] / sum[3];
  });
  grid.for_each_chunk(world, [&](Chunk<Dim>& chunk, Particles<Dim>& of) {
    if (std::ranges::all_of(of.held, [](double number) { return number == 0.0; })) return;
    if (of.held_gradient.size() == 0) of.held_gradient.setZero(Dim * Dim, of.count());
    const double* column = grid.gather(chunk, of, field);
    for (Index p = 0; p < of.count(); ++p, column += 4 * gathered_columns)
      for (int j = 0; j < Dim; ++j) of.held_gradient(axis + Dim * j, p) = column[4 * (4 + j)];
  });
}

}  // namespace

template <int Dim> void find_prescribed_nodes(World<Dim>& world, PointGrid<Dim>& grid) {
  if (world.prescribed_points.empty()) return;
  world.find_prescribed_places();
  Vector speed(world.num_points());
  std::vector<char> held(world.num_points());
  for (int axis = 0; axis < Dim; ++axis) {
    std::ranges::fill(held, 0);
    bool any = false, varies = false;
    for (const auto& group : world.prescribed_points) {
      if (group.axis != axis) continue;
      any = true;
      varies |= group.velocity.minCoeff() < group.velocity.maxCoeff();
      for (std::size_t k = 0; k < group.points.size(); ++k) {
        held[group.points[k]] = 1;
        speed[group.points[k]] = group.velocity[static_cast<Index>(k)];
      }
    }
    if (!any) continue;
    // Gradients are found from the field that they make: each pass halves their error, one a step is enough later.
    constexpr int first_passes = 10;
    const bool has_gradients = std::ranges::any_of(grid.particles, [&](const Particles<Dim>& of) {
      for (int j = 0; j < Dim && of.held_gradient.size() > 0; ++j)
        if (!of.held_gradient.row(axis + Dim * j).isZero(0.0)) return true;
      return false;
    });
    for (int pass = 0; pass < (varies && !has_gradients ? first_passes : 1); ++pass) {
      scatter_held(world, grid, held, speed, axis, varies);
      if (varies) gather_held(world, grid, axis);
    }
    for (Index a = 0; a < world.nodes.size(); ++a) {
      const Eigen::Vector4d sum = grid.sum_at_node(world, &Particles<Dim>::held, a);
      if (sum[3] >= 0.5 * world.nodes.mass[a] && sum[3] > 0.0) world.prescribed.push_back({a, axis, sum[0] / sum[3]});
    }
  }
  world.find_free_axes();
}

template void find_prescribed_nodes(World<2>&, PointGrid<2>&);
template void find_prescribed_nodes(World<3>&, PointGrid<3>&);

}  // namespace efree::internal
