// SPDX-License-Identifier: GPL-3.0-or-later
/// Loads on surfaces whose vertices move through the nodes, and which points they break with.
#include "efree/dynamics/internal/surface_functions.hpp"
#include "efree/dynamics/internal/surface_loads.hpp"

#include <cmath>

namespace efree::internal {
namespace {

/// Moving least squares at a position, of points up to two of their sizes further away than the nearest one.
template <int Dim> std::vector<std::pair<Index, double>> functions_of_points(const Neighbours<Dim>& tree,
                                                                             const Vector& sizes, const Vec<Dim>& at) {
  const Index nearest = tree.nearest(at);
  const double reach = (tree.points().col(nearest) - at).norm() + 2.0 * sizes[nearest];
  std::vector<Index> around;
  tree.within(at, reach, around);
  std::vector<WeightedNode<Dim>> nodes;
  for (const Index p : around) {
    const Vec<Dim> apart = tree.points().col(p) - at;
    nodes.push_back({p, apart / sizes[nearest], std::pow(1.0 - std::min(1.0, apart.norm() / reach), 2)});
  }
  return moving_least_squares(nodes);
}

}  // namespace

/// Of bodies without cells, and of those whose nodes do not stay: the material point nearest to each facet. And of
/// vertices that are carried by bodies without cells the functions of the points that they move with.
template <int Dim> void SurfaceLoads<Dim>::find_owners(const World<Dim>& world) {
  const auto body_of = [&](Index vertex) {
    return is_carried() ? load_.part.bodies[vertex]
                        : world.nodes.body[SparseRows::InnerIterator(functions_, vertex).col()];
  };
  std::vector<Eigen::Triplet<double, Index>> moving;
  for (Index b = 0; b < world.num_bodies(); ++b) {
    const bool has_cells = world.bodies[b].cells.cols() > 0;
    if (!is_carried() && has_cells) continue;
    owner_.resize(static_cast<std::size_t>(facets_.cols()), -1);
    Points<Dim> points(Dim, world.first_point[b + 1] - world.first_point[b]);
    Vector sizes(points.cols());
    for (const auto& chunk : world.chunks)
      for (Index p = 0; chunk.body == b && p < chunk.size(); ++p) {
        points.col(chunk.number[p]) = chunk.matter.x.col(p);
        sizes[chunk.number[p]] = std::pow(chunk.matter.volume[p], 1.0 / Dim);
      }
    Neighbours<Dim> tree;
    tree.build(points);
    for (Index f = 0; f < facets_.cols(); ++f)
      if (body_of(facets_(0, f)) == b)
        owner_[f] = world.first_point[b] + tree.nearest(facet_corners(start_, facets_, f).rowwise().mean());
    for (Index k = 0; k < start_.cols() && is_carried() && !has_cells; ++k)
      if (body_of(k) == b)
        for (const auto& [p, value] : functions_of_points<Dim>(tree, sizes, start_.col(k)))
          moving.emplace_back(k, world.first_point[b] + p, value);
  }
  if (moving.empty()) return;
  by_points_.resize(static_cast<Index>(start_.cols()), world.num_points());
  by_points_.setFromTriplets(moving.begin(), moving.end());
}

/// As add_forces, with functions of the nodes that there are now. Work is that along the motion of the vertices: what
/// the motion of the nodes differs from it, by transfers to the points and back, is lost to these.
template <int Dim> void SurfaceLoads<Dim>::add_carried_forces(World<Dim>& world) {
  const bool again = std::exchange(time_, world.time) == world.time;
  if (by_grid_.cols() > 0) follow_points(world);
  functions_ = world.functions_at(world, at_, load_.part.bodies);
  if (has_forces()) {
    const Points<Dim> before = std::exchange(forces_, tractions(world) + pressures(world));
    if (again && before.cols() == forces_.cols())
      world.ledger.add_energy("loads", EnergyKind::work,
                              0.5 * world.last_step * (before - forces_).cwiseProduct(velocities_).sum());
  }
  const Points<Dim> all = carried_forces(world);
  world.nodes.force += on_nodes(all);
  const double lost = 0.5 * world.last_step * all.cwiseProduct(velocities_ - at_vertices(world.nodes.v)).sum();
  world.ledger.add_energy("transfer", EnergyKind::transfer, again ? lost - transferred_ : lost);
  transferred_ = lost;
}
/// By vertex, of tractions, pressures and springs.
template <int Dim> Points<Dim> SurfaceLoads<Dim>::carried_forces(const World<Dim>& world) const {
  Points<Dim> all = has_forces() ? forces_ : Points<Dim>(Points<Dim>::Zero(Dim, at_.cols()));
  if (has_springs()) all -= spring_forces(world, displacements(world));
  return all;
}
/// Half of a step's work is that of the forces at its start, along the motion that vertices have in the step: with
/// the vertices of meshes that of the grid, else that of the points, which is known after these have moved.
template <int Dim> void SurfaceLoads<Dim>::carry_vertices(World<Dim>& world, double dt) {
  const Points<Dim> now = at_vertices(world.nodes.v);
  const bool follows_points = by_points_.rows() > 0;
  if (has_forces())
    world.ledger.add_energy(
        "loads", EnergyKind::work,
        0.5 * forces_.cwiseProduct(world.last_step * velocities_ + (follows_points ? 0.0 : dt) * now).sum());
  if (follows_points) {
    by_grid_ = now;
    return;
  }
  at_ += dt * now;
  velocities_ = now;
}
template <int Dim> void SurfaceLoads<Dim>::follow_points(World<Dim>& world) {
  Points<Dim> points(Dim, world.num_points());
  for (const auto& chunk : world.chunks)
    for (Index p = 0; p < chunk.size(); ++p) points.col(world.point_number(chunk, p)) = chunk.matter.x.col(p);
  const Points<Dim> before = carried_forces(world), moved = (by_points_ * points.transpose()).transpose() - at_;
  at_ += moved;
  velocities_ = moved / world.last_step;
  if (has_forces()) world.ledger.add_energy("loads", EnergyKind::work, 0.5 * forces_.cwiseProduct(moved).sum());
  world.ledger.add_energy("transfer", EnergyKind::transfer,
                          0.5 * before.cwiseProduct(moved - world.last_step * by_grid_).sum());
  by_grid_.resize(Dim, 0);
}

#define EFREE_INSTANTIATE(Dim)                                                     \
  template void SurfaceLoads<Dim>::find_owners(const World<Dim>&);                 \
  template void SurfaceLoads<Dim>::add_carried_forces(World<Dim>&);                \
  template Points<Dim> SurfaceLoads<Dim>::carried_forces(const World<Dim>&) const; \
  template void SurfaceLoads<Dim>::carry_vertices(World<Dim>&, double);            \
  template void SurfaceLoads<Dim>::follow_points(World<Dim>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
