// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/internal/kinetic_energy.hpp"

#include "efree/dynamics/masses.hpp"

namespace efree::internal {
namespace {

/// Dim x bodies: 1 along axes where nothing prescribes a velocity of a body, or of one that it is tied to; else 0.
template <int Dim> Points<Dim> find_unsupported_axes(const World<Dim>& world) {
  const Nodes<Dim>& nodes = world.nodes;
  Points<Dim> result = Points<Dim>::Ones(Dim, world.num_bodies());
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.mass[a] > 0.0) result.col(nodes.body[a]) = result.col(nodes.body[a]).cwiseMin(nodes.free.col(a));
  for (bool changes = true; changes;) {
    changes = false;
    for (Index a = 0; a < nodes.size(); ++a) {
      if (!nodes.follows(a)) continue;
      auto one = result.col(nodes.body[a]), other = result.col(nodes.body[nodes.master[a]]);
      const Vec<Dim> both = one.cwiseMin(other);
      changes |= both != one || both != other;
      one = other = both;
    }
  }
  return result;
}

/// Mass that gravity accelerates, by body: with mass scaling less than all of it.
template <int Dim> Vector falling_masses(const World<Dim>& world) {
  const Nodes<Dim>& nodes = world.nodes;
  Vector result = Vector::Zero(world.num_bodies());
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.mass[a] > 0.0)
      result[nodes.body[a]] +=
          world.options.mass_scaling.on() ? std::pow(world.real_mass(a), 2) / nodes.mass[a] : nodes.mass[a];
  return result;
}

}  // namespace

template <int Dim>
std::vector<char> find_resting_bodies(const World<Dim>& world, const std::vector<ContactImpulse<Dim>>& before) {
  if (world.gravity.isZero(0.0)) return {};
  using Kind = ContactPartner::Kind;
  std::vector<char> rests(static_cast<std::size_t>(world.num_bodies()), 0);
  std::vector<std::pair<Index, Index>> pairs;  // of bodies
  auto old = before.begin();
  for (const ContactImpulse<Dim>& now : world.contacts.all()) {  // new ones lie between the old
    const bool is_new = old == before.end() || old->first != now.first || old->second != now.second;
    const bool acts = is_new ? !now.impulse.isZero(0.0) : now.impulse != old->impulse;
    if (!is_new) ++old;
    if (!acts || now.first.kind != Kind::body) continue;
    if (now.second.kind == Kind::body)
      pairs.emplace_back(now.first.number, now.second.number);
    else
      rests[static_cast<std::size_t>(now.first.number)] = 1;
  }
  if (pairs.empty()) return rests;
  const Points<Dim> unsupported = find_unsupported_axes(world);
  const auto is_held = [&](Index b) {
    return rests[static_cast<std::size_t>(b)] != 0 || unsupported.col(b).cwiseProduct(world.gravity) != world.gravity;
  };
  for (bool changes = true; changes;) {
    changes = false;
    for (const auto& [a, b] : pairs)
      for (const auto& [one, other] : {std::pair(a, b), std::pair(b, a)}) {
        if (!is_held(one) || is_held(other)) continue;
        rests[static_cast<std::size_t>(other)] = 1;
        changes = true;
      }
  }
  return rests;
}

template <int Dim> std::vector<double> find_start_shares(const World<Dim>& world, double kick) {
  const Nodes<Dim>& nodes = world.nodes;
  std::vector<double> shares(static_cast<std::size_t>(world.num_bodies()), 0.0);
  const double falling = std::pow(kick, 2) * world.gravity.squaredNorm();
  if (!(falling > 0.0)) return shares;
  for (Index a = 0; a < nodes.size(); ++a)
    if (nodes.mass[a] > 0.0)
      shares[static_cast<std::size_t>(nodes.body[a])] +=
          nodes.mass[a] * nodes.free.col(a).cwiseProduct(nodes.v.col(a) - nodes.v_before.col(a)).squaredNorm();
  const Vector masses = falling_masses(world);
  for (Index b = 0; b < world.num_bodies(); ++b) {
    double& share = shares[static_cast<std::size_t>(b)];
    share = masses[b] > 0.0 ? std::min(1.0, share / (masses[b] * falling)) : 0.0;
  }
  return shares;
}

template <int Dim> KineticEnergy kinetic_energy(const World<Dim>& world, const std::vector<char>& resting,
                                                const std::vector<double>& start_shares) {
  const Nodes<Dim>& nodes = world.nodes;
  KineticEnergy result;
  for (Index a = 0; a < nodes.size(); ++a) {
    if (!(nodes.mass[a] > 0.0)) continue;
    const Vec<Dim> v = nodes.v.col(a), f = world.last_step * nodes.force.col(a),
                   by_free = f.cwiseProduct(nodes.free.col(a));
    result.kinetic += 0.5 * v.dot(momentum_of(world, a) + by_free);
    result.supports += 0.5 * v.dot(by_free - f);
  }
  const Vec<Dim> faster = 0.5 * world.last_step * world.gravity;
  if (faster.isZero(0.0)) return result;
  const Points<Dim> unsupported = find_unsupported_axes(world);
  const Vector masses = falling_masses(world);
  for (Index b = 0; b < world.num_bodies(); ++b) {
    const bool rests = !resting.empty() && resting[static_cast<std::size_t>(b)] != 0;
    const double all = 0.5 * masses[b] * faster.squaredNorm(),
                 falling = rests ? 0.0 : 0.5 * masses[b] * faster.cwiseProduct(unsupported.col(b)).squaredNorm();
    result.kinetic += falling;
    if (!start_shares.empty()) result.resting += start_shares[static_cast<std::size_t>(b)] * (all - falling);
  }
  return result;
}

#define EFREE_INSTANTIATE(Dim)                                                                                \
  template std::vector<char> find_resting_bodies(const World<Dim>&, const std::vector<ContactImpulse<Dim>>&); \
  template std::vector<double> find_start_shares(const World<Dim>&, double);                                  \
  template KineticEnergy kinetic_energy(const World<Dim>&, const std::vector<char>&, const std::vector<double>&);
EFREE_INSTANTIATE(2)
EFREE_INSTANTIATE(3)
#undef EFREE_INSTANTIATE

}  // namespace efree::internal
