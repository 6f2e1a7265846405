// SPDX-License-Identifier: GPL-3.0-or-later
/// Walls and rigid bodies against surface points that are no nodes.
#include "efree/dynamics/contact/internal/least_energy.hpp"
#include "efree/dynamics/contact/internal/rigid_contact.hpp"
#include "efree/dynamics/masses.hpp"

namespace efree::internal {
namespace {

/// Values at the nodes interpolated to a surface point.
template <int Dim> Vec<Dim> at_surface_point(const World<Dim>& world, Index s, const Points<Dim>& values) {
  return row_times<Dim>(world.surface_points.shape, s, values);
}

}  // namespace

/// Surface points within the skin of rigid bodies; found again when nodes or rigid bodies have moved so far that others
/// may be in contact.
template <int Dim> void RigidContact<Dim>::find_near_points(const World<Dim>& world) {
  const Points<Dim>& x = world.nodes.x;
  const SurfacePoints& surface = world.surface_points;
  if (inverse_mass_.follow(world))
    for (Rigid& rigid : rigids_) rigid.pushed = {};
  if (x_searched_.cols() != 0) {
    const double furthest = std::sqrt((x - x_searched_).colwise().squaredNorm().maxCoeff());
    double travelled = 0.0;
    for (const Rigid& rigid : rigids_) travelled = std::max(travelled, rigid.travelled);
    if (2.0 * (surface.reach * furthest + travelled) < surface.skin) return;
  }
  x_searched_ = x;
  const auto n = static_cast<Index>(surface.shape.rows());
  std::vector<Gap<Dim>> gaps(n);
  for (Rigid& rigid : rigids_) {
    parallel_for(n, [&](Index s) { gaps[s] = gap_to<Dim>(rigid.body, rigid.now, at_surface_point(world, s, x)); });
    std::vector<Index> found;
    for (Index s = 0; s < n; ++s)
      if (gaps[s].gap < surface.skin) found.push_back(s);
    Points<Dim> impulses = Points<Dim>::Zero(Dim, static_cast<Index>(found.size()));
    std::vector<DelayedFriction> friction(found.size());
    for (std::size_t k = 0; k < rigid.near_points.size(); ++k) {
      const auto place = std::lower_bound(found.begin(), found.end(), rigid.near_points[k]);
      if (place == found.end() || *place != rigid.near_points[k]) continue;
      impulses.col(place - found.begin()) = rigid.point_impulses.col(static_cast<Index>(k));
      friction[place - found.begin()] = rigid.point_friction[k];
    }
    if (found != rigid.near_points) rigid.pushed = {};
    rigid.near_points = std::move(found);
    rigid.point_impulses = std::move(impulses);
    rigid.point_friction = std::move(friction);
    rigid.travelled = 0.0;
  }
}

/// The largest impulses of friction on near points, by those along the normal.
template <int Dim> Points<1> RigidContact<Dim>::find_point_friction(const World<Dim>& world, Rigid& rigid,
                                                                    const Points<1>& normal, double dt) const {
  Points<1> most = Points<1>::Zero(1, normal.cols());
  for (Index k = 0; k < normal.cols(); ++k) {
    if (rigid.has_coulomb_friction()) {
      DelayedFriction& friction = rigid.point_friction[k];
      friction.press(rigid.body.friction * normal[k], dt, longest_delay(world));
      most[k] = friction.limit();
      friction.grant();
    } else if (normal[k] > 0.0 && rigid.body.friction > 0.0) {
      most[k] = std::numeric_limits<double>::infinity();
    }
  }
  return most;
}

/// Impulses on near points by which no point enters the rigid body within the step, and those of Coulomb friction.
/// Normal and tangential ones are independent where the rigid body is flat, as masses are the same along all axes.
/// Where it is curved those along the normal count friction of the last step, and friction counts them. by_friction:
/// the part of friction (Dim x near points). False if no point approaches or has friction.
template <int Dim> bool RigidContact<Dim>::find_point_impulses(const World<Dim>& world, Rigid& rigid, double dt,
                                                               Points<Dim>& by_friction) {
  const auto n = static_cast<Index>(rigid.near_points.size());
  Points<Dim> normals(Dim, n), velocities(Dim, n);
  Points<1> closing(1, n);
  parallel_chunks(n, 64, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      const Vec<Dim> at = at_surface_point(world, rigid.near_points[k], world.nodes.x);
      velocities.col(k) =
          at_surface_point(world, rigid.near_points[k], world.nodes.v) - velocity_of<Dim>(rigid.now, at);
      const Gap<Dim> gap = gap_to<Dim>(rigid.body, rigid.now, at);
      normals.col(k) = gap.normal;
      // Points inside move out within a stable step, not at once where a step is cut short.
      closing(0, k) = gap.gap / (gap.gap < 0.0 ? std::max(dt, world.stable_step) : dt);
    }
  });
  const auto along = [&](const Points<Dim>& values) { return Points<1>(normals.cwiseProduct(values).colwise().sum()); };
  const Vec<Dim> first = normals.col(0);
  const bool is_flat = (normals.colwise() - first).isZero(0.0);
  auto& [along_normal, along_axes, flat_normal] = rigid.pushed;
  const auto all_axes = [&]() -> const PushedPoints<Dim>& {
    if (!along_axes) along_axes.emplace(world, inverse_mass_, rigid.near_points, first);
    return *along_axes;
  };
  Points<1> normal = along(rigid.point_impulses), approach = along(velocities) + closing;
  const Points<Dim> before = rigid.point_impulses;
  if (!is_flat && rigid.body.friction > 0.0)
    approach += along(all_axes().velocities(before - normals * normal.asDiagonal()));
  const double largest = -approach.minCoeff();
  by_friction.setZero(Dim, n);
  if (largest <= 0.0 && !(rigid.body.friction > 0.0)) {
    rigid.point_impulses.setZero();
    return false;
  }
  const IterationEnd end = iteration_end(world, on_walls);
  const auto push = [](Index, const Vec<1>& q) { return Vec<1>(q.cwiseMax(0.0)); };
  if (largest <= 0.0) {
    normal.setZero();
  } else if (is_flat) {
    if (!along_normal || flat_normal != first) along_normal.emplace(world, inverse_mass_, rigid.near_points, first);
    flat_normal = first;
    minimise_energy<1>(*along_normal, approach, largest, end, push, normal);
  } else {
    minimise_energy<1>(NormalMobility<Dim, PushedPoints<Dim>>{all_axes(), normals}, approach, largest, end, push,
                       normal);
  }
  rigid.point_impulses = normals * normal.asDiagonal();
  const Points<1> most = find_point_friction(world, rigid, normal.cwiseMax(0.0), dt);
  if (!(most.maxCoeff() > 0.0)) return largest > 0.0;
  if (!is_flat) velocities += all_axes().velocities(rigid.point_impulses);
  by_friction = friction_impulses<Dim>(all_axes(), velocities, normals, most, largest, end, before);
  rigid.point_impulses += by_friction;
  return true;
}

template <int Dim> void RigidContact<Dim>::apply_to_surface(World<Dim>& world, Rigid& rigid, double dt) {
  if (world.surface_points.shape.rows() == 0) return;
  find_near_points(world);
  Points<Dim> friction;
  if (rigid.near_points.empty() || !find_point_impulses(world, rigid, dt, friction)) return;
  Nodes<Dim>& nodes = world.nodes;
  double lost = 0.0, lost_by_friction = 0.0;
  Points<Dim> on_nodes = Points<Dim>::Zero(Dim, nodes.size()), by_friction = on_nodes;
  for (Index k = 0; k < static_cast<Index>(rigid.near_points.size()); ++k) {
    const Vec<Dim> at = at_surface_point(world, rigid.near_points[k], nodes.x), velocity = rigid.mean_velocity(at);
    Vec<Dim> sum = Vec<Dim>::Zero(), sum_of_friction = sum;
    Index body = 0;
    for (SparseRows::InnerIterator entry(world.surface_points.shape, rigid.near_points[k]); entry; ++entry) {
      const auto free = entry.value() * nodes.free.col(entry.col());
      const Vec<Dim> on_node = free.cwiseProduct(rigid.point_impulses.col(k)),
                     friction_on_node = free.cwiseProduct(friction.col(k));
      on_nodes.col(entry.col()) += on_node;
      by_friction.col(entry.col()) += friction_on_node;
      sum += on_node;
      sum_of_friction += friction_on_node;
      body = nodes.body[entry.col()];
    }
    lost += sum.dot(velocity);
    lost_by_friction += sum_of_friction.dot(velocity);
    rigid.add_reaction(world, body, at, sum);
  }
  nodes.v += velocities_of(world, on_nodes);
  if (world.consistent_mass.any()) nodes.momentum += on_nodes;
  lost -= 0.5 * on_nodes.cwiseProduct(nodes.v + nodes.v_before).sum();
  lost_by_friction -= 0.5 * by_friction.cwiseProduct(nodes.v + nodes.v_before).sum();
  world.ledger.add_energy("contact", EnergyKind::loss, lost - lost_by_friction);
  world.ledger.add_energy("friction", EnergyKind::loss, lost_by_friction);
}

template void RigidContact<2>::apply_to_surface(World<2>&, Rigid&, double);
template void RigidContact<3>::apply_to_surface(World<3>&, Rigid&, double);

}  // namespace efree::internal
