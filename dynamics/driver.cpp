// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/driver.hpp"

#include "efree/dynamics/contact/internal/surfaces.hpp"
#include "efree/dynamics/internal/mass_scaling.hpp"
#include "efree/dynamics/internal/rest.hpp"
#include "efree/dynamics/internal/world.hpp"
#include "efree/dynamics/masses.hpp"
#include "efree/dynamics/points.hpp"

#include <fmt/format.h>

namespace efree::internal {
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

/// Adds velocities times a time. A sum that remembers what rounding keeps from it (Kahan 1965): over many steps,
/// angular momentum would feel it.
template <int Dim> void add(double time, const Points<Dim>& velocities, Points<Dim>& sum, Points<Dim>& rest) {
  parallel_chunks(static_cast<Index>(sum.cols()), 1024, [&](Index begin, Index end) {
    for (Eigen::Index k = Dim * begin; k < Dim * end; ++k) {
      const double change = time * velocities(k) + rest(k), before = sum(k);
      sum(k) += change;
      rest(k) = change - (sum(k) - before);
    }
  });
}

/// Velocities after the forces have acted for that time.
template <int Dim> void accelerate(World<Dim>& world, double time) {
  Nodes<Dim>& nodes = world.nodes;
  if (!world.consistent_mass.any()) {
    parallel_for(nodes.size(), [&](Index a) {
      if (nodes.mass[a] > 0.0) nodes.v.col(a) += time * nodes.force.col(a) / nodes.mass[a];
    });
    return;
  }
  thread_local Points<Dim> impulses, changes;
  impulses = time * nodes.force;
  find_velocities(world, impulses, changes);
  nodes.v += changes;
  nodes.momentum += impulses;
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

}  // namespace

template <int Dim> Driver<Dim>::Driver(std::vector<DeformableBody<Dim>> bodies, std::unique_ptr<Scheme<Dim>> given,
                                       const DynamicsOptions& options)
    : scheme(std::move(given)) {
  require(scheme != nullptr, "explicit dynamics: expected a scheme, such as otm() or total_lagrangian()");
  std::vector<PointStorage> storage;
  for (const DeformableBody<Dim>& body : bodies) storage.push_back(scheme->point_storage(body));
  construct(world, bodies, storage, options);
  identity = identify<Dim>(bodies, *scheme, options);
  auto rigid_contact = std::make_unique<RigidContact<Dim>>(*scheme);
  auto gas = std::make_unique<Cavities<Dim>>();
  auto gravity_forces = std::make_unique<Gravity<Dim>>();
  rigid = rigid_contact.get();
  cavities = gas.get();
  gravity = gravity_forces.get();
  world.interactions.push_back(std::move(gravity_forces));
  world.interactions.push_back(prescribed_velocities<Dim>());
  world.interactions.push_back(body_contact<Dim>(*scheme));
  world.interactions.push_back(std::move(rigid_contact));
  world.interactions.push_back(std::move(gas));
  world.interactions.push_back(damping<Dim>());
  begin_ledger();
  scheme->begin(world, bodies);
  bodies = {};  // the memory is for what follows
  if (options.tied) tie_bodies(world);
  world.find_node_chunks();
  world.find_free_axes();
  find_momenta(world);
  require_surfaces(world, *scheme);
  compute_internal_forces(world, *scheme, 0.0);
  begin_watch();
  use_large_pages(world);
  if (!scheme->stable_step(world)) stable.begin(world);
  stable.update_stiffness_ratios(world);
  estimate_stable_step(first_products);
  world.unscaled_step = world.stable_step / std::sqrt(options.mass_scaling.factor);
  add_masses(world, *scheme, stable);
  world.first_stable_step = world.stable_step;
}

template <int Dim> void Driver<Dim>::begin_ledger() {
  using enum EnergyKind;
  for (const auto& [name, kind] :
       {std::pair("kinetic", kinetic), std::pair("stored", stored), std::pair("dissipated", dissipated),
        std::pair("stabilisation", stabilising), std::pair("viscous", loss), std::pair("contact", loss),
        std::pair("friction", loss), std::pair("fracture", loss), std::pair("prescribed", work),
        std::pair("gravity", work)})
    world.ledger.add_energy(name, kind, 0.0);
  for (const char* name : {"point updates", "eroded points", "penetrated points"}) world.ledger.add_count(name, 0);
}

template <int Dim> void Driver<Dim>::begin_watch() {
  watch = {};
  // A run that goes on from earlier steps has all of it in its balance already.
  start_shares.assign(world.last_step > 0.0 ? static_cast<std::size_t>(world.num_bodies()) : 0, 0.0);
  world.added_inertia = {};
  if (world.options.mass_scaling.on()) inertia.begin(world);
  // Energies of bodies at rest are rounding: some 1e-17 of moduli times volumes.
  for (const auto& chunk : world.chunks) watch.scale += 1e-15 * chunk.matter.modulus.dot(chunk.matter.volume);
  // Those of bodies under pressure are differences of pressures times volumes, in every step.
  for (const auto& chunk : world.chunks)
    watch.scale += 1e-12 * world.bodies[chunk.body].reference_pressure * chunk.matter.volume.sum();
}

template <int Dim> double Driver<Dim>::step(double at_most) {
  begin_supports();
  if (std::exchange(lacks_walls, false)) add_forces_of_walls();
  if (!watch.begun) watch.look(leapfrog_energies());
  if (world.steps == 0) estimate_first_damping(world);
  const double dt = choose_step(at_most);
  if (!world.motion_laws.empty()) {
    world.follow_motion_laws(world.time, dt);
    scheme->find_prescribed(world);
  }
  last_kick = 0.5 * (world.last_step + dt);
  advance_nodes(last_kick, dt);
  world.time += dt;
  world.last_step = dt;
  scheme->refresh(world, stable);
  compute_internal_forces(world, *scheme, dt);
  add_external_forces();
  break_points();
  if (++world.steps % between_checks == 0) inspect();
  if (world.options.mass_scaling.on()) inertia.sample(world, world.added_inertia);
  estimate_stable_step(1, stable.is_due(world));
  return dt;
}

/// Of schemes that hold nodes off walls themselves: bodies may be in contact with these from the start on.
template <int Dim> void Driver<Dim>::add_forces_of_walls() {
  const bool has_tables = std::ranges::any_of(world.chunks, [](const auto& chunk) { return chunk.has_table(); });
  if (world.walls.empty() || has_tables || !scheme->nodes_persist()) return;
  scheme->resume(world);
  assemble_internal_forces(world, *scheme, false);
  scheme->refresh(world, stable);  // with the contacts that are known now
  assemble_internal_forces(world, *scheme, false);
  add_external_forces();
}

template <int Dim> void Driver<Dim>::begin_supports() {
  if (!std::exchange(world.new_supports, false)) return;
  world.find_free_axes();
  find_momenta(world);
  // Supports may have slowed the fastest mode down: the bound would be too long until the next estimates.
  estimate_stable_step(first_products);
  if (world.steps == 0) world.first_stable_step = world.stable_step;
}

template <int Dim> double Driver<Dim>::choose_step(double at_most) {
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

template <int Dim> void Driver<Dim>::advance_nodes(double kick, double dt) {
  auto start = std::chrono::steady_clock::now();
  Nodes<Dim>& nodes = world.nodes;
  nodes.v_before = nodes.v;
  accelerate(world, kick);
  const std::vector<ContactImpulse<Dim>> contacts = world.contacts.all();
  for (const auto& interaction : world.interactions) interaction->apply_impulses(world, kick, dt);
  for (const auto& interaction : world.interactions) interaction->finish_kick(world, kick, dt);
  resting = find_resting_bodies(world, contacts);
  if (start_shares.empty()) start_shares = find_start_shares(world, kick);
  add<Dim>(dt, nodes.v, nodes.x, nodes.x_rest);
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.follows(a))
      for (Points<Dim>* values : {&nodes.x, &nodes.x_rest, &nodes.v}) values->col(a) = values->col(nodes.master[a]);
  if (world.axisymmetric())
    for (Index a = 0; a < nodes.size(); ++a)
      if (nodes.x(0, a) < 0.0) nodes.x(0, a) = nodes.x_rest(0, a) = 0.0;
  world.ledger.add_time("nodes", seconds_since(start));
}

template <int Dim> void Driver<Dim>::add_external_forces() {
  for (const auto& interaction : world.interactions) interaction->add_forces(world);
}

template <int Dim> void Driver<Dim>::break_points() {
  if (std::ranges::none_of(world.bodies, [](const auto& body) { return body.fracture.on(); })) return;
  auto start = std::chrono::steady_clock::now();
  const std::vector<Index> broken = fracture.find_broken(world);
  world.ledger.add_time("fracture", seconds_since(start));
  if (!broken.empty()) erode(broken);
}

template <int Dim> void Driver<Dim>::erode(const std::vector<Index>& broken) {
  erode_points(world, *scheme, broken);
  const Points<Dim> before = world.nodes.force;
  assemble_internal_forces(world, *scheme);
  add_external_forces();
  // Leapfrog's next impulse, from half a step ago on, is without them: from then on they stored no more.
  world.ledger.add_energy("fracture", EnergyKind::loss,
                          -0.5 * world.last_step * world.nodes.v.cwiseProduct(world.nodes.force - before).sum());
}

template <int Dim> void Driver<Dim>::inspect() {
  stable.update_stiffness_ratios(world);
  for (const auto& interaction : world.interactions) interaction->inspect(world);
  watch.look(leapfrog_energies());
  const double error = watch.error(), imbalance = world.options.imbalance;
  watch.beyond = std::abs(error) <= imbalance ? 0 : watch.beyond + 1;
  if (!std::isfinite(error))
    throw NumericalError(fmt::format("at time {:.6g} the energies are not finite", world.time));
  // Rigid bodies with a mass wait until all is at rest, with the energy of half a step of fall.
  if (watch.beyond >= checks_in_a_row && !world.stands_still)
    throw NumericalError(fmt::format(
        "at time {:.6g} the energy is off by {:.2g} %, more than the imbalance of {:.2g} %: smaller steps (courant) "
        "or finer bodies may help",
        world.time, 100.0 * error, 100.0 * imbalance));
}

template <int Dim> EnergyBalance<Dim> Driver<Dim>::balance_with(const KineticEnergy& now) const {
  const Nodes<Dim>& nodes = world.nodes;
  EnergyBalance<Dim> result{.energies = world.ledger};
  for (Index a = 0; a < nodes.size(); ++a) {
    if (!(nodes.mass[a] > 0.0)) continue;
    const Vec<Dim> l = momentum_of(world, a);
    result.momentum += l;
    result.angular_momentum += moment_about_origin<Dim>(nodes.x.col(a), l);
  }
  Ledger& energies = result.energies;
  energies.add_energy("kinetic", EnergyKind::kinetic, now.kinetic);
  energies.add_energy("prescribed", EnergyKind::work, now.supports);
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

template <int Dim> EnergyBalance<Dim> Driver<Dim>::balance() const {
  return balance_with(kinetic_energy(world, resting, start_shares));
}

template <int Dim> Ledger Driver<Dim>::leapfrog_energies() const {
  const KineticEnergy now = kinetic_energy(world, resting, start_shares);
  Ledger result = balance_with(now).energies;
  result.add_energy("kinetic", EnergyKind::kinetic, now.resting + rigid->resting_energy(world));
  return result;
}

template <int Dim> void Driver<Dim>::estimate_stable_step(Index most_products, bool is_due) {
  if (const auto known = scheme->stable_step(world)) {
    double squared = 0.0;
    for (const auto& interaction : world.interactions) squared += interaction->squared_frequency(world);
    const double limit = 2.0 * world.options.courant;
    world.stable_step = squared > 0.0 ? limit / std::sqrt(squared + std::pow(limit / *known, 2)) : *known;
  } else if (is_due) {
    stable.estimate(world, most_products);
  }
}

template <int Dim> void Driver<Dim>::pack(Archive& archive) {
  StateIdentity of = identity;
  archive(of);
  require(of.scheme == identity.scheme, "the state is one of another scheme");
  internal::pack(world, watch, archive);
  inertia.pack(archive);
  archive(resting, start_shares);
  stable.pack(archive);
  scheme->pack(archive);
  for (const auto& interaction : world.interactions) interaction->pack(archive);
}

template struct Driver<2>;
template struct Driver<3>;

}  // namespace efree::internal
