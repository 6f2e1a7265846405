// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/dynamics.hpp"

#include "efree/dynamics/contact/internal/rigid_contact.hpp"
#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/fracture/internal/fracture.hpp"
#include "efree/dynamics/internal/loads.hpp"
#include "efree/dynamics/internal/stable_step.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>

namespace efree {
namespace {

/// How much smaller (its logarithm) a point may get in a step, at the rate of the last one: what is compressed faster
/// is inverted before its pressure acts.
constexpr double most_compressed = 0.2;
/// Over the stable step, to which that may shorten it: the scheme deals with points that ask for more, or they break.
constexpr double least_step = 0.05;
/// Products with the stiffness of the first estimate of the stable step.
constexpr Index first_products = 40;
/// Steps between checks of the energy, and of how stiff points are.
constexpr Index between_checks = 64;
/// Checks in a row at which the energy is off before a run ends: while there is little of it, it may swing.
constexpr Index checks_in_a_row = 8;

/// A sum that remembers what rounding keeps from it (Kahan 1965): over many steps, angular momentum would feel it.
template <int Dim> void add(const Points<Dim>& more, Points<Dim>& sum, Points<Dim>& rest) {
  for (Eigen::Index k = 0; k < sum.size(); ++k) {
    const double change = more(k) + rest(k), before = sum(k);
    sum(k) += change;
    rest(k) = change - (sum(k) - before);
  }
}

template <int Dim> void require_surfaces(const World<Dim>& world, const Scheme<Dim>& scheme) {
  if (world.num_bodies() < 2 || !world.options.contact.enabled) return;
  for (Index b = 0; b < world.num_bodies(); ++b)
    if (world.bodies[b].cells.cols() == 0 && scheme.surface(world, b).cols() == 0)
      throw InputError(
          fmt::format("body {}: it has no cells, and so no surface for contact with others: give it "
                      "cells, or take contact.enabled = false",
                      b));
}

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

/// The state, the scheme and the interactions, in the order in which they act.
template <int Dim> struct Dynamics<Dim>::Parts {
  World<Dim> world;
  std::unique_ptr<Scheme<Dim>> scheme;
  internal::StableStep<Dim> stable;
  internal::Fracture<Dim> fracture;
  EnergyWatch watch;
  internal::RigidContact<Dim>* rigid = nullptr;  ///< of world.interactions, as the next
  internal::Cavities<Dim>* cavities = nullptr;

  Parts(const std::vector<DeformableBody<Dim>>& bodies, std::unique_ptr<Scheme<Dim>> given,
        const DynamicsOptions& options)
      : scheme(std::move(given)) {
    require(scheme != nullptr, "explicit dynamics: expected a scheme, such as otm() or total_lagrangian()");
    internal::construct(world, bodies, options);
    auto rigid_contact = std::make_unique<internal::RigidContact<Dim>>(*scheme);
    auto gas = std::make_unique<internal::Cavities<Dim>>();
    rigid = rigid_contact.get();
    cavities = gas.get();
    world.interactions.push_back(internal::gravity<Dim>());
    world.interactions.push_back(internal::prescribed_velocities<Dim>());
    world.interactions.push_back(internal::body_contact<Dim>(*scheme));
    world.interactions.push_back(std::move(rigid_contact));
    world.interactions.push_back(std::move(gas));
    using enum EnergyKind;
    for (const auto& [name, kind] :
         {std::pair("kinetic", kinetic), std::pair("stored", stored), std::pair("dissipated", dissipated),
          std::pair("stabilisation", stabilising), std::pair("viscous", loss), std::pair("contact", loss),
          std::pair("fracture", loss), std::pair("prescribed", work), std::pair("gravity", work)})
      world.ledger.add_energy(name, kind, 0.0);
    for (const char* name : {"point updates", "eroded points", "penetrated points"}) world.ledger.add_count(name, 0);
    scheme->begin(world, bodies);
    world.find_node_chunks();
    world.find_free_axes();
    find_momenta(world);
    require_surfaces(world, *scheme);
    compute_internal_forces(world, *scheme, 0.0);
    // Energies of bodies at rest are rounding: some 1e-17 of moduli times volumes.
    for (const auto& chunk : world.chunks) watch.scale += 1e-15 * chunk.matter.modulus.dot(chunk.matter.volume);
    internal::use_large_pages(world);
    stable.begin(world);
    stable.update_stiffness_ratios(world);
    estimate_stable_step(first_products);
    world.first_stable_step = world.stable_step;
  }

  double step(double at_most) {
    begin_supports();
    if (!watch.begun) watch.look(balance().energies);
    if (world.steps == 0) estimate_first_damping(world);
    const double dt = choose_step(at_most);
    if (!world.velocity_laws.empty()) {
      world.follow_velocity_laws(world.time + 0.5 * dt);
      scheme->find_prescribed(world);
    }
    advance_nodes(0.5 * (world.last_step + dt), dt);
    world.time += dt;
    world.last_step = dt;
    scheme->refresh(world, stable);
    compute_internal_forces(world, *scheme, dt);
    add_external_forces();
    break_points();
    if (++world.steps % between_checks == 0) inspect();
    estimate_stable_step(1, stable.is_due(world));
    return dt;
  }

  /// Velocities were prescribed.
  void begin_supports() {
    if (!std::exchange(world.new_supports, false)) return;
    world.find_free_axes();
    find_momenta(world);
    // Supports may have slowed the fastest mode down: the bound would be too long until the next estimates.
    estimate_stable_step(first_products);
    if (world.steps == 0) world.first_stable_step = world.stable_step;
  }

  double choose_step(double at_most) {
    // Viscous forces lag behind by half a step: the bound of damped vibrations by the fastest.
    double damping = 0.0, bound = at_most;
    for (auto& chunk : world.chunks) {
      damping = std::max(damping, chunk.damping);
      const BodyState<Dim>& body = world.bodies[chunk.body];
      const double least = body.holds_inverted || body.fracture.on() ? least_step * world.stable_step : 0.0;
      if (const double rate = std::exchange(chunk.compression_rate, 0.0); rate > 0.0)
        bound = std::min(bound, std::max(most_compressed / rate, least));
    }
    bound = std::min(bound, world.stable_step * (std::sqrt(1.0 + damping * damping) - damping));
    for (const auto& interaction : world.interactions) bound = std::min(bound, interaction->longest_step(world));
    if (!(bound > 0.0) || !std::isfinite(bound))
      throw NumericalError(
          fmt::format("at time {:.6g} the stable step is {:.3g}, where nodes move at up to {:.3g} along an axis",
                      world.time, bound, world.nodes.size() > 0 ? world.nodes.v.cwiseAbs().maxCoeff() : 0.0));
    return bound;
  }

  /// Nodes get their impulses, and move.
  void advance_nodes(double kick, double dt) {
    auto start = std::chrono::steady_clock::now();
    Nodes<Dim>& nodes = world.nodes;
    nodes.v_before = nodes.v;
    thread_local Points<Dim> impulses, changes;
    impulses = kick * nodes.force;
    find_velocities(world, impulses, changes);
    nodes.v += changes;
    if (world.consistent_mass.any()) nodes.momentum += impulses;
    for (const auto& interaction : world.interactions) interaction->apply_impulses(world, kick, dt);
    for (const auto& interaction : world.interactions) interaction->finish_kick(world, kick, dt);
    changes = dt * nodes.v;
    add<Dim>(changes, nodes.x, nodes.x_rest);
    if (world.axisymmetric())
      for (Index a = 0; a < nodes.size(); ++a)
        if (nodes.x(0, a) < 0.0) nodes.x(0, a) = nodes.x_rest(0, a) = 0.0;
    world.ledger.add_time("nodes", seconds_since(start));
  }

  void add_external_forces() {
    for (const auto& interaction : world.interactions) interaction->add_forces(world);
  }

  void break_points() {
    if (std::ranges::none_of(world.bodies, [](const auto& body) { return body.fracture.on(); })) return;
    auto start = std::chrono::steady_clock::now();
    const std::vector<Index> broken = fracture.find_broken(world);
    world.ledger.add_time("fracture", seconds_since(start));
    if (!broken.empty()) erode(broken);
  }

  void erode(const std::vector<Index>& broken) {
    internal::erode_points(world, *scheme, broken);
    const Points<Dim> before = world.nodes.force;
    assemble_internal_forces(world, *scheme);
    add_external_forces();
    // Leapfrog's next impulse, from half a step ago on, is without them: from then on they stored no more.
    world.ledger.add_energy("fracture", EnergyKind::loss,
                            -0.5 * world.last_step * world.nodes.v.cwiseProduct(world.nodes.force - before).sum());
  }

  /// How stiff points are, and whether the energy is what it should be.
  void inspect() {
    stable.update_stiffness_ratios(world);
    for (const auto& interaction : world.interactions) interaction->inspect(world);
    watch.look(balance().energies);
    const double error = watch.error(), imbalance = world.options.imbalance;
    watch.beyond = std::abs(error) <= imbalance ? 0 : watch.beyond + 1;
    if (!std::isfinite(error))
      throw NumericalError(fmt::format("at time {:.6g} the energies are not finite", world.time));
    if (watch.beyond >= checks_in_a_row)
      throw NumericalError(fmt::format(
          "at time {:.6g} the energy is off by {:.2g} %, more than the imbalance of {:.2g} %: smaller steps (courant) "
          "or finer bodies may help",
          world.time, 100.0 * error, 100.0 * imbalance));
  }

  EnergyBalance<Dim> balance() const {
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
    for (const double energy : stabilisation_energies(world))
      energies.add_energy("stabilisation", EnergyKind::stabilising, energy);
    for (const auto& chunk : world.chunks) {
      energies.add_energy("stored", EnergyKind::stored, chunk.stored);
      energies.add_energy("dissipated", EnergyKind::dissipated, chunk.dissipated);
      energies.add_energy("viscous", EnergyKind::loss, chunk.viscous);
    }
    for (const auto& interaction : world.interactions) interaction->tally(world, result);
    scheme->tally(world, result);
    return result;
  }

  void estimate_stable_step(Index most_products, bool is_due = true) {
    if (const auto known = scheme->stable_step(world))
      world.stable_step = *known;
    else if (is_due)
      stable.estimate(world, most_products);
  }

  void pack(Archive& archive) {
    std::string name = scheme->name();
    archive(name);
    require(name == scheme->name(), "the state is one of another scheme");
    internal::pack(world, watch, archive);
    stable.pack(archive);
    scheme->pack(archive);
    for (const auto& interaction : world.interactions) interaction->pack(archive);
  }
};

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

template <int Dim> void Dynamics<Dim>::prescribe(const std::vector<Index>& nodes, int axis, VelocityLaw<Dim> velocity) {
  World<Dim>& world = parts_->world;
  require(velocity != nullptr && axis >= 0 && axis < Dim &&
              std::ranges::all_of(nodes, [&](Index node) { return node >= 0 && node < num_nodes(); }),
          "prescribe: expected a law for an axis of nodes that there are");
  world.velocity_laws.push_back(std::move(velocity));
  for (const Index node : nodes) {
    const Vec<Dim> start = world.nodes.x.col(node);
    prescribe(node, axis, world.velocity_laws.back()(start, world.time));
    world.prescribed.back().law = static_cast<Index>(world.velocity_laws.size()) - 1;
    world.prescribed.back().start = start;
  }
}

template <int Dim>
void Dynamics<Dim>::prescribe_points(std::vector<Index> points, int axis, VelocityLaw<Dim> velocity) {
  require(velocity != nullptr, "prescribe_points: expected a law");
  World<Dim>& world = parts_->world;
  const Points<Dim> now = this->points();
  Points<Dim> start(Dim, std::ssize(points));
  Vector values(start.cols());
  for (Index k = 0; k < start.cols(); ++k) {
    require(points[k] >= 0 && points[k] < now.cols(), "prescribe_points: expected points that there are");
    start.col(k) = now.col(points[k]);
    values[k] = velocity(start.col(k), world.time);
  }
  prescribe_points(std::move(points), axis, values);
  world.velocity_laws.push_back(std::move(velocity));
  world.prescribed_points.back().law = static_cast<Index>(world.velocity_laws.size()) - 1;
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
  const auto damage_of = [](const Matter<Dim>& matter, Index p) { return Vec<1>(matter.damage[p]); };
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
  return by_point<Tensors>(world(), 9, [](const Matter<Dim>& matter, Index p) {
    const Mat<3> F = matter.F_since[p] * Eigen::Map<const Mat<3>>(matter.F_table.col(p).data());
    return Vec<9>(F.reshaped());
  });
}
template <int Dim> Tensors Dynamics<Dim>::cauchy_stress() const {
  return by_point<Tensors>(world(), 9, [](const Matter<Dim>& matter, Index p) {
    const Eigen::Map<const Mat<3>> F(matter.now.F.col(p).data()), P(matter.response.P.col(p).data());
    const Mat<3> sigma = P * F.transpose() / F.determinant();
    return Vec<9>(sigma.reshaped());
  });
}
template <int Dim> Matrix Dynamics<Dim>::history(Index body) const {
  const auto history_of = [](const Matter<Dim>& matter, Index p) { return matter.now.history.col(p); };
  const Index begin = first_point(body), end = first_point(body + 1);
  return by_point<Matrix>(world(), material(body).history_size(), history_of, begin, end);
}

template <int Dim> EnergyBalance<Dim> Dynamics<Dim>::balance() const {
  return parts_->balance();
}

template <int Dim> double Dynamics<Dim>::step(double at_most) {
  return parts_->step(at_most);
}

template <int Dim> void Dynamics<Dim>::run(double until) {
  while (time() < until) {
    step(step_towards(until - time()));
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
