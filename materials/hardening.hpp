// SPDX-License-Identifier: GPL-3.0-or-later
/// How a yield stress changes as plastic strain accumulates.
#pragma once

#include "efree/materials/piecewise_linear.hpp"

#include <functional>
#include <variant>
#include <vector>

namespace efree {

/// Yield stress [stress] as a function of the equivalent plastic strain a >= 0; never below zero, where softening ends.
/// All throw InputError for parameters out of range.
class Hardening {
 public:
  /// None: the yield stress is constant.
  Hardening(double yield) : Hardening(linear(yield, 0.0)) {}
  /// Any function and its derivative; pure, they are called from many threads.
  Hardening(std::function<double(double)> stress, std::function<double(double)> slope)
      : law_(Function{std::move(stress), std::move(slope)}) {}
  /// yield + modulus a, softening if the modulus is negative.
  static Hardening linear(double yield, double modulus);
  /// yield (1 + a / strain)^exponent (Swift 1952); a finite slope at a = 0, unlike Ludwik's.
  static Hardening power_law(double yield, double strain, double exponent);
  /// yield + modulus a^exponent (Ludwik 1909), modulus not negative, exponent positive.
  static Hardening ludwik(double yield, double modulus, double exponent);
  /// saturation - (saturation - yield) exp(-rate a) + modulus a (Voce 1948); modulus not negative.
  static Hardening voce(double yield, double saturation, double rate, double modulus = 0.0);
  /// Linear between points, constant beyond the last. Strains ascend from zero.
  static Hardening table(std::vector<double> strain, std::vector<double> stress);

  /// Of a curve of hardening.
  struct Value {
    double stress;  ///< yield stress
    double slope;   ///< its derivative by a
  };
  Value at(double a) const;
  /// The integral of the yield stress from a to b [stress]; of functions by Gauss's rule with five points.
  double work(double a, double b) const;
  /// Whether it falls somewhere (but for tables looked for at a few plastic strains from 0 to 1).
  bool falls() const;

 private:
  struct Linear {
    double yield, modulus;
  };
  struct PowerLaw {
    double yield, strain, exponent;
  };
  struct Ludwik {
    double yield, modulus, exponent;
  };
  struct Voce {
    double yield, saturation, rate, modulus;
  };
  struct Function {
    std::function<double(double)> stress, slope;
  };
  using Law = std::variant<Linear, PowerLaw, Ludwik, Voce, PiecewiseLinear, Function>;
  explicit Hardening(Law law) : law_(std::move(law)) {}

  Law law_;
};

}  // namespace efree
