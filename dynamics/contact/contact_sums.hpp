// SPDX-License-Identifier: GPL-3.0-or-later
/// Who is in contact with whom, and by what impulses.
#pragma once

#include "efree/dynamics/ledger.hpp"

#include <algorithm>
#include <compare>
#include <tuple>
#include <vector>

namespace efree {

/// A body, a rigid body or a wall, numbered among its kind.
struct ContactPartner {
  enum class Kind { body, rigid_body, wall };
  Kind kind = Kind::body;
  Index number = 0;

  auto operator<=>(const ContactPartner&) const = default;
  friend auto fields(ContactPartner& of) {
    auto& [kind, number] = of;
    return std::tie(kind, number);
  }
};

/// The impulse of contact of the second on the first so far, in the plane per unit thickness, axisymmetric of the full
/// revolution.
template <int Dim> struct ContactImpulse {
  ContactPartner first{}, second{};               ///< first < second: bodies before rigid bodies before walls
  Vec<Dim> impulse = Vec<Dim>::Zero();            ///< [force time]
  Spin<Dim> angular_impulse = Spin<Dim>::Zero();  ///< about the origin [length force time]

  friend auto fields(ContactImpulse& of) {
    auto& [first, second, impulse, angular_impulse] = of;
    return std::tie(first, second, impulse, angular_impulse);
  }
};

/// The impulses of all pairs so far. Contact of a body with itself is none of them: it sums up to nothing.
template <int Dim> class ContactSums {
 public:
  /// Adds an impulse of one on the other at a position; the one gets the opposite impulse.
  void add(const ContactPartner& on, const ContactPartner& of, const Vec<Dim>& at, const Vec<Dim>& impulse) {
    ContactImpulse<Dim>& sum = on < of ? find(on, of) : find(of, on);
    const double sign = on < of ? 1.0 : -1.0;
    sum.impulse += sign * impulse;
    sum.angular_impulse += sign * moment_about_origin<Dim>(at, impulse);
  }
  /// Ascending by the first, then by the second. None of what never was in contact.
  const std::vector<ContactImpulse<Dim>>& all() const { return sums_; }

  friend auto fields(ContactSums& of) { return std::tie(of.sums_); }

 private:
  ContactImpulse<Dim>& find(const ContactPartner& first, const ContactPartner& second) {
    const auto key = [](const ContactImpulse<Dim>& of) { return std::pair(of.first, of.second); };
    const std::pair wanted(first, second);
    const auto place = std::ranges::lower_bound(sums_, wanted, {}, key);
    if (place != sums_.end() && key(*place) == wanted) return *place;
    return *sums_.insert(place, {.first = first, .second = second});
  }

  std::vector<ContactImpulse<Dim>> sums_;
};

/// A deformable body as a partner.
inline ContactPartner body_partner(Index number) {
  return {ContactPartner::Kind::body, number};
}

}  // namespace efree
