// SPDX-License-Identifier: GPL-3.0-or-later
/// A step of the driver.
#include "efree/dynamics/internal/parts.hpp"
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
/// Checks in a row at which the energy is off before a run ends: while there is little of it, as at the start, it may
/// swing.
constexpr Index checks_in_a_row = 8;

/// A sum that remembers what rounding keeps from it (Kahan 1965): over many steps, angular momentum would feel it.
template <int Dim> void add(const Points<Dim>& more, Points<Dim>& sum, Points<Dim>& rest) {
  for (Eigen::Index a = 0; a < sum.cols(); ++a)
    for (int i = 0; i < Dim; ++i) {
      const double change = more(i, a) + rest(i, a), before = sum(i, a);
      sum(i, a) += change;
      rest(i, a) = change - (sum(i, a) - before);
    }
}

template <int Dim> void require_surfaces(const World<Dim>& world, const Scheme<Dim>& scheme) {
  if (world.num_bodies() < 2 || world.options.contact.stiffness == 0.0) return;
  for (Index b = 0; b < world.num_bodies(); ++b)
    if (scheme.surface(world, b).cols() == 0)
      throw InputError(
          fmt::format("body {}: it has no cells, and so no surface for contact with others: give it cells, or take "
                      "contact.stiffness = 0",
                      b));
}

}  // namespace

template <int Dim> Dynamics<Dim>::Parts::Parts(const std::vector<DeformableBody<Dim>>& bodies,
                                               std::unique_ptr<Scheme<Dim>> given, const DynamicsOptions& options)
    : scheme(std::move(given)) {
  require(scheme != nullptr, "explicit dynamics: expected a scheme, such as otm() or total_lagrangian()");
  internal::construct(world, bodies, options);
  auto rigid_contact = std::make_unique<internal::RigidContact<Dim>>();
  auto gas = std::make_unique<internal::Cavities<Dim>>();
  rigid = rigid_contact.get();
  cavities = gas.get();
  world.interactions.push_back(internal::gravity<Dim>());
  world.interactions.push_back(internal::body_contact<Dim>(*scheme));
  world.interactions.push_back(internal::prescribed_velocities<Dim>());
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

template <int Dim> void Dynamics<Dim>::Parts::estimate_stable_step(Index most_products) {
  if (const auto known = scheme->stable_step(world))
    world.stable_step = *known;
  else
    stable.estimate(world, most_products);
}

/// Velocities were prescribed.
template <int Dim> void Dynamics<Dim>::Parts::begin_supports() {
  if (!std::exchange(world.new_supports, false)) return;
  world.find_free_axes();
  find_momenta(world);
  // What is left of the fastest mode where nodes are supported is slow: the bound would be too long until it is found
  // again.
  estimate_stable_step(first_products);
  if (world.steps == 0) world.first_stable_step = world.stable_step;
}

template <int Dim> double Dynamics<Dim>::Parts::choose_step(double at_most) {
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
template <int Dim> void Dynamics<Dim>::Parts::advance_nodes(double kick, double dt) {
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

template <int Dim> void Dynamics<Dim>::Parts::add_external_forces() {
  for (const auto& interaction : world.interactions) interaction->add_forces(world);
}

template <int Dim> void Dynamics<Dim>::Parts::erode(const std::vector<Index>& broken) {
  internal::erode_points(world, *scheme, broken);
  const Points<Dim> before = world.nodes.force;
  assemble_internal_forces(world);
  add_external_forces();
  // Leapfrog's next impulse, from half a step ago on, is without them: from then on they stored no more.
  world.ledger.add_energy("fracture", EnergyKind::loss,
                          -0.5 * world.last_step * world.nodes.v.cwiseProduct(world.nodes.force - before).sum());
}

template <int Dim> void Dynamics<Dim>::Parts::break_points() {
  if (std::ranges::none_of(world.bodies, [](const auto& body) { return body.fracture.on(); })) return;
  auto start = std::chrono::steady_clock::now();
  const std::vector<Index> broken = fracture.find_broken(world);
  world.ledger.add_time("fracture", seconds_since(start));
  if (!broken.empty()) erode(broken);
}

/// How stiff points are, and whether the energy is what it should be.
template <int Dim> void Dynamics<Dim>::Parts::inspect() {
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

template <int Dim> double Dynamics<Dim>::Parts::step(double at_most) {
  begin_supports();
  if (!watch.begun) watch.look(balance().energies);
  if (world.steps == 0) estimate_first_damping(world);
  const double dt = choose_step(at_most);
  advance_nodes(0.5 * (world.last_step + dt), dt);
  world.time += dt;
  world.last_step = dt;
  scheme->refresh(world, stable);
  compute_internal_forces(world, *scheme, dt);
  add_external_forces();
  break_points();
  if (++world.steps % between_checks == 0) inspect();
  if (scheme->stable_step(world) || stable.is_due(world)) estimate_stable_step(1);
  return dt;
}

template struct Dynamics<2>::Parts;
template struct Dynamics<3>::Parts;

}  // namespace efree
