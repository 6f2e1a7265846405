// SPDX-License-Identifier: GPL-3.0-or-later
/// Forces of contact over a run of explicit dynamics.
#pragma once

#include "efree/analysis/dynamics.hpp"

#include <string>
#include <utility>
#include <vector>

namespace efree {

/// Forces between all pairs of bodies, rigid bodies and walls in contact: means between the lines of a history, as
/// forces of single steps are those of waves.
template <int Dim> class ContactForces {
 public:
  /// Forces and moments about the origin of the partner on a body.
  struct Pair {
    std::string body, with;  ///< the region, or "body" without a name; likewise, or "rigid_body.0", "wall.0"
    Vec<Dim> impulse = Vec<Dim>::Zero();            ///< so far [force time]
    Spin<Dim> angular_impulse = Spin<Dim>::Zero();  ///< so far
    Vec<Dim> force = Vec<Dim>::Zero();              ///< mean since the line before the last
    Spin<Dim> moment = Spin<Dim>::Zero();           ///< likewise; of no meaning axisymmetric
    Vec<Dim> peak = Vec<Dim>::Zero();               ///< the largest of these means so far
    double peak_begin = 0.0, peak_end = 0.0;        ///< [time] that it is the mean over

    std::string name() const { return body + '.' + with; }
    friend auto fields(Pair& of) {
      auto& [body, with, impulse, angular_impulse, force, moment, peak, peak_begin, peak_end] = of;
      return std::tie(body, with, impulse, angular_impulse, force, moment, peak, peak_begin, peak_end);
    }
  };

  /// A line of the history: the forces since the last one.
  void add_line(const DynamicsModel<Dim>& model);
  const std::vector<Pair>& pairs() const { return pairs_; }  ///< in the order in which they first were in contact

  friend auto fields(ContactForces& of) { return std::tie(of.pairs_, of.time_); }

 private:
  std::vector<Pair> pairs_;
  double time_ = 0.0;  ///< of the last line
};

}  // namespace efree
