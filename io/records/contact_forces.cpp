// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/contact_forces.hpp"

#include <algorithm>

namespace efree {
namespace {

std::string name_of(const ContactPartner& partner, const std::vector<std::string>& bodies) {
  if (partner.kind != ContactPartner::Kind::body) return rigid_partner_name(partner);
  const std::string& region = bodies[static_cast<std::size_t>(partner.number)];
  return region.empty() ? "body" : region;
}

}  // namespace

template <int Dim> void ContactForces<Dim>::add_line(const DynamicsModel<Dim>& model) {
  const double begin = std::exchange(time_, model.dynamics.time()), since = time_ - begin;
  for (const ContactImpulse<Dim>& now : model.dynamics.contacts()) {
    const std::string body = name_of(now.first, model.names);
    const std::string with = name_of(now.second, model.names);
    auto pair = std::ranges::find_if(pairs_, [&](const Pair& of) { return of.body == body && of.with == with; });
    if (pair == pairs_.end()) pair = pairs_.insert(pair, {.body = body, .with = with});
    const Vec<Dim> impulse = now.impulse - std::exchange(pair->impulse, now.impulse);
    const Spin<Dim> angular = now.angular_impulse - std::exchange(pair->angular_impulse, now.angular_impulse);
    if (!(since > 0.0)) continue;
    pair->force = impulse / since;
    pair->moment = angular / since;
    if (!(pair->force.norm() > pair->peak.norm())) continue;
    pair->peak = pair->force;
    pair->peak_begin = begin;
    pair->peak_end = time_;
  }
}

template class ContactForces<2>;
template class ContactForces<3>;

}  // namespace efree
