// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/dynamics.hpp"

#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/internal/driver.hpp"
#include "efree/dynamics/internal/mass_scaling.hpp"
#include "efree/dynamics/internal/rest.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>

namespace efree {
namespace {

/// A column for each of the points [begin, end), by default all: value(matter, number in the chunk).
template <class Result, int Dim, class Value>
Result by_point(const World<Dim>& world, Index rows, const Value& value, Index begin = 0, Index end = -1) {
  if (end < 0) end = world.num_points();
  Result result(rows, end - begin);
  for (Index p = begin; p < end; ++p) {
    const auto [chunk, k] = world.locate(p);
    result.col(p - begin) = value(chunk.matter, k);
  }
  return result;
}

}  // namespace

template <int Dim> struct Dynamics<Dim>::Parts : internal::Driver<Dim> { using internal::Driver<Dim>::Driver; };

template <int Dim> Dynamics<Dim>::Dynamics(std::vector<DeformableBody<Dim>> bodies, std::unique_ptr<Scheme<Dim>> scheme,
                                           const DynamicsOptions& options)
    : parts_(std::make_unique<Parts>(std::move(bodies), std::move(scheme), options)) {}
template <int Dim> Dynamics<Dim>::Dynamics(Dynamics&&) noexcept = default;
template <int Dim> Dynamics<Dim>& Dynamics<Dim>::operator=(Dynamics&&) noexcept = default;
template <int Dim> Dynamics<Dim>::~Dynamics() = default;

template <int Dim> const World<Dim>& Dynamics<Dim>::world() const {
  return parts_->world;
}
template <int Dim> std::string Dynamics<Dim>::scheme() const {
  return parts_->scheme->name();
}

template <int Dim> bool Dynamics<Dim>::nodes_persist() const {
  return parts_->scheme->nodes_persist();
}

template <int Dim> void Dynamics<Dim>::add_wall(const Wall<Dim>& wall) {
  const RigidShape<Dim> half_space = rigid_shapes::half_space<Dim>(wall.normal, wall.level);
  parts_->rigid->add(parts_->world, {.shape = half_space, .friction = wall.friction}, true);
  parts_->world.walls.push_back(wall);
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
  parts_->world.interactions.back()->add_forces(parts_->world);
  parts_->world.new_supports = true;
  parts_->watch.begun = false;
}

template <int Dim> void Dynamics<Dim>::prescribe(Index node, int axis, double velocity) {
  World<Dim>& world = parts_->world;
  if (node < 0 || node >= num_nodes() || axis < 0 || axis >= Dim)
    throw InputError(fmt::format("axis {} of node {}: there are {} nodes", axis, node, num_nodes()));
  node = world.nodes.master_of(node);
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

template <int Dim>
void Dynamics<Dim>::prescribe(const std::vector<Index>& nodes, int axis, VelocityLaw<Dim> law, bool is_displacement) {
  World<Dim>& world = parts_->world;
  require(law != nullptr && axis >= 0 && axis < Dim &&
              std::ranges::all_of(nodes, [&](Index node) { return node >= 0 && node < num_nodes(); }),
          "prescribe: expected a law for an axis of nodes that there are");
  world.motion_laws.push_back({std::move(law), is_displacement});
  for (const Index node : nodes) {
    const Vec<Dim> start = world.nodes.x.col(node);
    prescribe(node, axis, is_displacement ? 0.0 : world.motion_laws.back().law(start, world.time));
    world.prescribed.back().law = static_cast<Index>(world.motion_laws.size()) - 1;
    world.prescribed.back().start = start;
  }
}

template <int Dim>
void Dynamics<Dim>::prescribe_points(std::vector<Index> points, int axis, VelocityLaw<Dim> law, bool is_displacement) {
  require(law != nullptr, "prescribe_points: expected a law");
  World<Dim>& world = parts_->world;
  const Points<Dim> now = this->points();
  Points<Dim> start(Dim, std::ssize(points));
  Vector values = Vector::Zero(start.cols());
  for (Index k = 0; k < start.cols(); ++k) {
    require(points[k] >= 0 && points[k] < now.cols(), "prescribe_points: expected points that there are");
    start.col(k) = now.col(points[k]);
    if (!is_displacement) values[k] = law(start.col(k), world.time);
  }
  prescribe_points(std::move(points), axis, values);
  world.motion_laws.push_back({std::move(law), is_displacement});
  world.prescribed_points.back().law = static_cast<Index>(world.motion_laws.size()) - 1;
  world.prescribed_points.back().start = std::move(start);
}

template <int Dim> void Dynamics<Dim>::prescribe_points(std::vector<Index> points, int axis, const Vector& velocity) {
  if (parts_->scheme->nodes_persist())
    throw InputError(fmt::format("prescribe_points: {} has nodes that stay with the material, prescribe theirs",
                                 parts_->scheme->name()));
  require(axis >= 0 && axis < Dim && velocity.size() == std::ssize(points) && velocity.allFinite() &&
              std::ranges::is_sorted(points) && !points.empty() && points.front() >= 0 && points.back() < num_points(),
          "prescribe_points: expected points, ascending, with a velocity for each along an axis");
  World<Dim>& world = parts_->world;
  world.prescribed_points.push_back({std::move(points), axis, velocity});
  parts_->scheme->collect_forces(world);
  parts_->add_external_forces();
  world.new_supports = true;
  parts_->watch.begun = false;
}

template <int Dim> void Dynamics<Dim>::set_gravity(const Vec<Dim>& acceleration) {
  World<Dim>& world = parts_->world;
  if (!acceleration.allFinite()) throw InputError("gravity: expected numbers");
  if (world.axisymmetric() && acceleration[0] != 0.0)
    throw InputError(fmt::format(
        "gravity of {:.6g} along the radius of an axisymmetric section, expected one along y alone", acceleration[0]));
  if (world.gravity_field) parts_->gravity->set_field(world, {});
  world.nodes.force += (acceleration - world.gravity) * world.real_masses().transpose();
  world.gravity = acceleration;
  world.gravity_law = {};
  parts_->watch.begun = false;
}
template <int Dim> void Dynamics<Dim>::set_gravity_law(std::function<Vec<Dim>(double time)> acceleration) {
  require(acceleration != nullptr, "set_gravity_law: expected a law");
  set_gravity(acceleration(time()));
  parts_->world.gravity_law = std::move(acceleration);
}

template <int Dim> void Dynamics<Dim>::set_gravity_field(GravityField<Dim> acceleration) {
  require(acceleration != nullptr, "set_gravity_field: expected a field");
  set_gravity(Vec<Dim>::Zero());
  parts_->gravity->set_field(parts_->world, std::move(acceleration));
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
  const auto damage_of = [](const Matter<Dim>& matter, Index p) { return Vec<1>(matter.damage_at(p)); };
  return by_point<Points<1>>(world(), 1, damage_of).transpose();
}

template <int Dim> std::vector<Index> Dynamics<Dim>::points_in_others() const {
  const World<Dim>& world = parts_->world;
  const bool in_contact = world.options.contact.enabled ||
                          std::ranges::any_of(world.interactions, [](const auto& one) { return one->is_contact(); });
  if (!in_contact || world.num_bodies() < 2 || !nodes_persist()) return {};
  internal::BodySurfaces<Dim> surfaces;
  surfaces.find(world, *parts_->scheme);
  return internal::points_in_others(world, surfaces);
}

template <int Dim> Overlap Dynamics<Dim>::deepest_overlap() const {
  const World<Dim>& world = parts_->world;
  if (!world.options.contact.enabled || world.num_bodies() < 2 || !nodes_persist()) return {};
  return internal::deepest_overlap(world, *parts_->scheme);
}

template <int Dim> Index Dynamics<Dim>::num_inverted() const {
  Index count = 0;
  for (const auto& chunk : world().chunks) count += static_cast<Index>(chunk.inverted.size());
  return count;
}

template <int Dim> Points<Dim> Dynamics<Dim>::points() const {
  return by_point<Points<Dim>>(world(), Dim, [](const Matter<Dim>& matter, Index p) { return matter.x.col(p); });
}
template <int Dim> Points<Dim> Dynamics<Dim>::point_velocities() const {
  return parts_->scheme->point_velocities(world());
}
template <int Dim> Tensors Dynamics<Dim>::deformation() const {
  return by_point<Tensors>(
      world(), 9, [](const Matter<Dim>& matter, Index p) { return Vec<9>(matter.own_gradient(p).reshaped()); });
}
template <int Dim> Tensors Dynamics<Dim>::cauchy_stress() const {
  return by_point<Tensors>(world(), 9, [](const Matter<Dim>& matter, Index p) {
    const Eigen::Map<const Mat<3>> F(matter.now.F.col(p).data()), P(matter.P.col(p).data());
    const Mat<3> sigma = P * F.transpose() / F.determinant();
    return Vec<9>(sigma.reshaped());
  });
}
template <int Dim> Matrix Dynamics<Dim>::history(Index body) const {
  const auto history_of = [](const Matter<Dim>& matter, Index p) { return matter.now.history.col(p); };
  const Index begin = first_point(body), end = first_point(body + 1);
  return by_point<Matrix>(world(), material(body).history_size(), history_of, begin, end);
}

template <int Dim> double Dynamics<Dim>::residual() const {
  return internal::residual(world(), parts_->last_kick);
}
template <int Dim> EnergyBalance<Dim> Dynamics<Dim>::balance() const {
  return parts_->balance();
}

template <int Dim> double Dynamics<Dim>::step(double at_most) {
  return parts_->step(at_most);
}

template <int Dim> void Dynamics<Dim>::come_to_rest(double residual, Index most_steps, const Spin<Dim>& spin,
                                                    const std::function<void(double)>& look) {
  World<Dim>& world = parts_->world;
  require(steps() == 0 && residual > 0.0, "come_to_rest: expected a positive residual, before the first step");
  const double rest_from = std::exchange(world.options.rest_from, 0.0);
  set_velocities(Points<Dim>::Zero(Dim, num_nodes()));
  world.stands_still = true;
  world.frame_spin = spin;
  constexpr Index between_looks = 16;
  Index next_look = between_looks;
  double left = std::numeric_limits<double>::infinity();
  for (Index k = 1; left > residual; ++k) {
    if (k > most_steps)
      throw NumericalError(
          fmt::format("bodies are not at rest after {} steps: the residual is {:.3g}, expected {:.3g}. "
                      "They may slide or roll freely, or have no place to rest",
                      most_steps, left, residual));
    parts_->step(std::numeric_limits<double>::infinity());
    world.time = 0.0;
    if (k < next_look) continue;
    left = this->residual();
    next_look = k + (std::isfinite(left) ? between_looks : 1);  // nodes that just stopped say nothing
    if (look) look(left);
  }
  world.stands_still = false;
  world.options.rest_from = rest_from;
  world.steps = world.steps_of_earlier_run = 0;
  world.last_step = 0.0;
  parts_->rigid->begin_motions(world);
  Points<Dim> velocities(Dim, num_nodes());
  for (Index a = 0; a < num_nodes(); ++a) velocities.col(a) = rotation_velocity<Dim>(spin, world.nodes.x.col(a));
  world.frame_spin.setZero();
  world.ledger = Ledger();
  world.contacts = {};
  parts_->begin_ledger();
  assemble_internal_forces(world, *parts_->scheme);
  parts_->add_external_forces();
  set_velocities(velocities);
}

template <int Dim> void Dynamics<Dim>::set_velocities(const Points<Dim>& velocities) {
  World<Dim>& world = parts_->world;
  require(steps() == 0 && velocities.cols() == num_nodes(),
          "set_velocities: expected those of all nodes, before the first step");
  world.nodes.v = velocities;
  for (const auto& one : world.prescribed) world.nodes.v(one.axis, one.node) = one.velocity;
  find_momenta(world);
  parts_->begin_watch();
}

template <int Dim>
void Dynamics<Dim>::begin_from(std::string_view state, bool velocities, const std::vector<std::string>& names) {
  const World<Dim>& world = parts_->world;
  require(world.steps == 0 && world.walls.empty() && world.prescribed.empty() && world.prescribed_points.empty(),
          "begin_from: expected a run without walls, supports and steps");
  parts_->begin_from(state, velocities, names);
}
template <int Dim>
void Dynamics<Dim>::set_stresses(const std::function<std::optional<Mat<3>>(Index body, const Vec<Dim>& x)>& stress) {
  require(stress != nullptr && steps() == 0, "set_stresses: expected stresses, before the first step");
  parts_->set_stresses(stress);
}
template <int Dim> double Dynamics<Dim>::imbalance(const std::vector<Index>& in_contact) const {
  return internal::imbalance(world(), in_contact);
}
template <int Dim> std::vector<BodyMass> Dynamics<Dim>::body_masses() const {
  return internal::body_masses(world());
}
template <int Dim> AddedInertia Dynamics<Dim>::added_inertia() const {
  return world().added_inertia;
}

template <int Dim> void Dynamics<Dim>::run(double until) {
  while (time() < until) {
    step(step_towards(until - time()));
    if (until - time() < 1e-12 * until) break;
  }
}

template <int Dim> EnergyWatch Dynamics<Dim>::energy() const {
  EnergyWatch result = parts_->watch;
  result.look(parts_->leapfrog_energies());
  return result;
}

template <int Dim> Ledger Dynamics<Dim>::ledger() const {
  Ledger result = parts_->world.ledger;
  constexpr const char* names[] = {"kinematics", "materials", "forces"};
  for (const auto& chunk : parts_->world.chunks)
    for (std::size_t k = 0; k < chunk.seconds.size(); ++k) result.add_time(names[k], chunk.seconds[k]);
  return result;
}

template <int Dim> std::string Dynamics<Dim>::state() const {
  Packer packer;
  Archive archive(packer);
  parts_->pack(archive);
  return std::move(packer).bytes();
}

template <int Dim> void Dynamics<Dim>::restore(std::string_view state) {
  Parts& parts = *parts_;
  World<Dim>& world = parts.world;
  const auto bodies = world.bodies;
  const std::string before = this->state();
  const auto take = [&](std::string_view bytes) {
    Unpacker unpacker(bytes);
    Archive archive(unpacker);
    parts.pack(archive);
    return world.bodies.size() == bodies.size() && unpacker.empty();
  };
  bool same = false;
  try {
    same = take(state);
  } catch (const InputError&) {
  }
  if (!same) {
    world.bodies = bodies;
    take(before);
  }
  world.find_node_chunks();
  world.find_free_axes();
  ++world.point_changes;
  parts.scheme->resume(world);
  internal::use_large_pages(world);
  if (!same) throw InputError("the state is damaged, or not of bodies, walls and a scheme such as these");
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
