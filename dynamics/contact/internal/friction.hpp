// SPDX-License-Identifier: GPL-3.0-or-later
/// Coulomb's law of friction, which follows the normal load with a delay.
#pragma once

#include "efree/dynamics/state.hpp"

namespace efree::internal {

/// How far from contact a node still has friction, and from where on none is due any more, over the spacing.
inline constexpr double friction_gap = 0.1, forgotten_gap = 2.0;

/// How long friction lags behind the load at most, in stable steps with a Courant number of one.
template <int Dim> double longest_delay(const World<Dim>& world) {
  return 100.0 * world.stable_step / world.options.courant;
}

/// The friction that a place in contact bears. Coulomb's law without delay has no solution that converges where elastic
/// bodies slide: the waves that it excites grow the faster the shorter they are (Adams 1995; Ranjith & Rice 2001),
/// until surfaces hop and friction is half of what it should be. Here the strength follows mu times the load by two
/// exponential means, 2 m1 - m2, which lag behind neither a constant nor a steadily growing load (Prakash & Clifton
/// 1993; Brown 1956). What is granted sums up to mu times the impulse of the load,
/// but where the contact ends while the load falls: an impact has about 3 % more.
class DelayedFriction {
 public:
  /// A step with mu times the impulse of the load on the place. The delay is a tenth of the time in contact, so that
  /// impacts have it, too, and at most `longest`.
  void press(double impulse, double dt, double longest) {
    if (!(age_ > 0.0) && !(impulse > 0.0)) return;
    age_ += dt;
    const double keep = std::exp(-dt / std::min(delay_by_age * age_, longest));
    strength_ = keep * strength_ + (1.0 - keep) * impulse / dt;
    mean_ = keep * mean_ + (1.0 - keep) * strength_;
    balance_ += dt * (2.0 * strength_ - mean_);
    gain_ = 1.0 - keep * keep;
  }
  /// The largest impulse of friction in this step, and its derivative with respect to that of `press`.
  double limit() const { return std::max(0.0, balance_); }
  double gain() const { return balance_ > 0.0 ? gain_ : 0.0; }
  /// The limit was granted, whether or not friction took all of it.
  void grant() { balance_ = std::min(0.0, balance_); }

  friend auto fields(DelayedFriction& of) {
    auto& [age, strength, mean, balance, gain] = of;
    return std::tie(age, strength, mean, balance);
  }

 private:
  static constexpr double delay_by_age = 0.1;

  double age_ = 0.0;                    ///< time in contact
  double strength_ = 0.0, mean_ = 0.0;  ///< mean forces
  double balance_ = 0.0;                ///< impulse that is to be granted
  double gain_ = 0.0;                   ///< of the balance by the last impulse
};

}  // namespace efree::internal
