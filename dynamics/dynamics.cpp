// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/dynamics.hpp"

#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/internal/parts.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>

namespace efree {
namespace {

/// A column for each of the points [begin, end): value(matter, number in the chunk).
template <class Result, int Dim, class Value>
Result by_point(const World<Dim>& world, Index rows, Index begin, Index end, const Value& value) {
  Result result(rows, end - begin);
  for (Index p = begin; p < end; ++p) {
    const auto [chunk, k] = world.locate(p);
    result.col(p - begin) = value(chunk.matter, k);
  }
  return result;
}

}  // namespace

template <int Dim> Dynamics<Dim>::Dynamics(std::vector<DeformableBody<Dim>> bodies, std::unique_ptr<Scheme<Dim>> scheme,
                                           const DynamicsOptions& options)
    : parts_(std::make_unique<Parts>(bodies, std::move(scheme), options)) {}
template <int Dim> Dynamics<Dim>::Dynamics(Dynamics&&) noexcept = default;
template <int Dim> Dynamics<Dim>& Dynamics<Dim>::operator=(Dynamics&&) noexcept = default;
template <int Dim> Dynamics<Dim>::~Dynamics() = default;

template <int Dim> const World<Dim>& Dynamics<Dim>::world() const {
  return parts_->world;
}
template <int Dim> std::string Dynamics<Dim>::scheme() const {
  return parts_->scheme->name();
}

template <int Dim> void Dynamics<Dim>::add_wall(const Wall<Dim>& wall) {
  parts_->rigid->add(parts_->world,
                     {.shape = rigid_shapes::half_space<Dim>(wall.normal, wall.level), .friction = wall.friction},
                     true);
}
template <int Dim> void Dynamics<Dim>::add_rigid_body(const RigidBody<Dim>& body) {
  parts_->rigid->add(parts_->world, body, false);
  parts_->watch.begun = false;
}
template <int Dim> void Dynamics<Dim>::add_cavity(const GasCavity<Dim>& cavity) {
  parts_->cavities->add(parts_->world, cavity);
  parts_->watch.begun = false;
}
template <int Dim> void Dynamics<Dim>::add_interaction(std::unique_ptr<Interaction<Dim>> interaction) {
  require(interaction != nullptr, "add_interaction: expected an interaction");
  parts_->world.interactions.push_back(std::move(interaction));
  parts_->world.new_supports = true;
  parts_->watch.begun = false;
}

template <int Dim> void Dynamics<Dim>::prescribe(Index node, int axis, double velocity) {
  World<Dim>& world = parts_->world;
  if (node < 0 || node >= num_nodes() || axis < 0 || axis >= Dim)
    throw InputError(fmt::format("axis {} of node {}: there are {} nodes", axis, node, num_nodes()));
  world.prescribed.push_back({node, axis, velocity});
  world.nodes.v(axis, node) = velocity;
  world.new_supports = true;
  parts_->watch.begun = false;
}
template <int Dim>
void Dynamics<Dim>::prescribe(std::function<bool(const Vec<Dim>&)> where, int axis, double velocity) {
  World<Dim>& world = parts_->world;
  if (!where || axis < 0 || axis >= Dim) throw InputError(fmt::format("axis {}: expected 0 to {}", axis, Dim - 1));
  for (Index a = 0; a < num_nodes(); ++a)
    if (where(world.nodes.x.col(a))) prescribe(a, axis, velocity);
  world.prescribed_places.push_back({std::move(where), axis, velocity});
}

template <int Dim> void Dynamics<Dim>::set_gravity(const Vec<Dim>& acceleration) {
  World<Dim>& world = parts_->world;
  if (!acceleration.allFinite()) throw InputError("gravity: expected numbers");
  if (world.axisymmetric() && acceleration[0] != 0.0)
    throw InputError(fmt::format(
        "gravity of {:.6g} along the radius of an axisymmetric section, expected one along y alone", acceleration[0]));
  world.nodes.force += (acceleration - world.gravity) * world.nodes.mass.transpose();
  world.gravity = acceleration;
  parts_->watch.begun = false;
}

template <int Dim> void Dynamics<Dim>::erode(Index point) {
  if (point < 0 || point >= num_points())
    throw InputError(fmt::format("point {} is to be eroded, and there are {}", point, num_points()));
  if (!is_eroded(point)) parts_->erode({point});
}
template <int Dim> Vector Dynamics<Dim>::release_rates() const {
  return parts_->fracture.release_rates(parts_->world);
}
template <int Dim> Vector Dynamics<Dim>::damage() const {
  return by_point<Matrix>(world(), 1, 0, num_points(),
                          [](const Matter<Dim>& matter, Index p) { return Vec<1>(matter.damage[p]); })
      .transpose();
}

template <int Dim> std::vector<Index> Dynamics<Dim>::points_in_others() const {
  const World<Dim>& world = parts_->world;
  const bool in_contact = world.options.contact.stiffness > 0.0 ||
                          std::ranges::any_of(world.interactions, [](const auto& one) { return one->is_contact(); });
  if (!in_contact || world.num_bodies() < 2) return {};
  internal::BodySurfaces<Dim> surfaces;
  surfaces.find(world, *parts_->scheme);
  return internal::points_in_others(world, surfaces);
}

template <int Dim> Index Dynamics<Dim>::num_inverted() const {
  std::size_t count = 0;
  for (const auto& chunk : parts_->world.chunks) count += chunk.inverted.size();
  return static_cast<Index>(count);
}

template <int Dim> Points<Dim> Dynamics<Dim>::points() const {
  return by_point<Points<Dim>>(world(), Dim, 0, num_points(),
                               [](const Matter<Dim>& matter, Index p) { return matter.x.col(p); });
}
template <int Dim> Tensors Dynamics<Dim>::deformation() const {
  return by_point<Tensors>(world(), 9, 0, num_points(), [](const Matter<Dim>& matter, Index p) {
    const Mat<3> F = matter.F_since[p] * Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
    return Vec<9>(F.reshaped());
  });
}
template <int Dim> Tensors Dynamics<Dim>::cauchy_stress() const {
  return by_point<Tensors>(world(), 9, 0, num_points(), [](const Matter<Dim>& matter, Index p) {
    const Eigen::Map<const Mat<3>> F(matter.now.F.col(p).data()), P(matter.response.P.col(p).data());
    const Mat<3> sigma = P * F.transpose() / F.determinant();
    return Vec<9>(sigma.reshaped());
  });
}
template <int Dim> Matrix Dynamics<Dim>::history(Index body) const {
  return by_point<Matrix>(world(), material(body).history_size(), first_point(body), first_point(body + 1),
                          [](const Matter<Dim>& matter, Index p) { return matter.now.history.col(p); });
}

template <int Dim> EnergyBalance<Dim> Dynamics<Dim>::Parts::balance() const {
  const Nodes<Dim>& nodes = world.nodes;
  EnergyBalance<Dim> result{.energies = world.ledger};
  double kinetic = 0.0;
  for (Index a = 0; a < nodes.size(); ++a) {
    if (!(nodes.mass[a] > 0.0)) continue;
    // Half a step ago; and the energy with that half a step from now.
    const Vec<Dim> l = momentum_of(world, a);
    kinetic += 0.5 * nodes.v.col(a).dot(l + world.last_step * nodes.force.col(a));
    result.momentum += l;
    result.angular_momentum += moment_about_origin<Dim>(nodes.x.col(a), l);
  }
  // What falls freely has the energy of its velocity now, whatever steps there were.
  const Vec<Dim> faster = 0.5 * world.last_step * world.gravity;
  kinetic += 0.5 * nodes.mass.sum() * faster.squaredNorm();
  Ledger& energies = result.energies;
  energies.add_energy("kinetic", EnergyKind::kinetic, kinetic);
  for (const auto& chunk : world.chunks) {
    energies.add_energy("stored", EnergyKind::stored, chunk.stored);
    energies.add_energy("dissipated", EnergyKind::dissipated, chunk.dissipated);
    energies.add_energy("viscous", EnergyKind::loss, chunk.viscous);
    double stabilisation = 0.0;
    for (Index p = 0; p < chunk.size(); ++p) stabilisation += stabilisation_energy(world, chunk, p);
    energies.add_energy("stabilisation", EnergyKind::stabilising, stabilisation);
  }
  for (const auto& interaction : world.interactions) interaction->tally(world, result);
  scheme->tally(world, result);
  return result;
}
template <int Dim> EnergyBalance<Dim> Dynamics<Dim>::balance() const {
  return parts_->balance();
}

template <int Dim> double Dynamics<Dim>::step(double at_most) {
  return parts_->step(at_most);
}

template <int Dim> void Dynamics<Dim>::run(double until) {
  while (time() < until) {
    const double left = until - time();
    // The last two share what is left, so that no step is tiny.
    step(left > stable_step() && left < 2.0 * stable_step() ? 0.5 * left : left);
    if (until - time() < 1e-12 * until) break;
  }
}

template <int Dim> EnergyWatch Dynamics<Dim>::energy() const {
  EnergyWatch result = parts_->watch;
  result.look(balance().energies);
  return result;
}

template <int Dim> Ledger Dynamics<Dim>::ledger() const {
  Ledger result = parts_->world.ledger;
  constexpr const char* names[] = {"kinematics", "materials", "forces"};
  for (const auto& chunk : parts_->world.chunks)
    for (std::size_t k = 0; k < chunk.seconds.size(); ++k) result.add_time(names[k], chunk.seconds[k]);
  return result;
}
template <int Dim> Points<Dim> Dynamics<Dim>::wall_forces() const {
  return parts_->rigid->wall_forces();
}
template <int Dim> std::vector<RigidState<Dim>> Dynamics<Dim>::rigid_bodies() const {
  return parts_->rigid->rigid_bodies();
}

template class Dynamics<2>;
template class Dynamics<3>;

}  // namespace efree
