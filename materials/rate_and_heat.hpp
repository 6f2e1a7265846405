// SPDX-License-Identifier: GPL-3.0-or-later
/// How the yield stress of a metal changes with the rate of strain and with temperature.
#pragma once

#include "efree/materials/piecewise_linear.hpp"

#include <optional>
#include <variant>

namespace efree {

/// A factor and its derivative.
struct Factor {
  double value, slope;
};

/// By how much a yield stress is larger than at rest, by the rate of the equivalent plastic strain [1/time]. All throw
/// InputError for parameters out of range.
class RateFactor {
 public:
  RateFactor() = default;  ///< always 1
  /// 1 + C ln(rate / reference), from the reference rate on; 1 below (Johnson & Cook 1983). C is not negative.
  static RateFactor johnson_cook(double C, double reference);
  /// 1 + (rate / D)^(1 / q) (Cowper & Symonds 1957): a stress above the yield stress Y flows at D (stress / Y - 1)^q
  /// (Perzyna 1966). D and q are positive.
  static RateFactor cowper_symonds(double D, double q);

  /// Linear in ln(rate) between these points, constant below the first and beyond the last. Rates are positive and
  /// ascend, factors are positive and do not fall.
  static RateFactor table(std::vector<double> rate, std::vector<double> factor);

  bool constant() const { return law_.index() == 0; }
  Factor at(double rate) const;

 private:
  struct JohnsonCook {
    double C, reference;
  };
  struct CowperSymonds {
    double D, exponent;
  };
  using Law = std::variant<std::monostate, JohnsonCook, CowperSymonds, PiecewiseLinear>;
  explicit RateFactor(Law law) : law_(std::move(law)) {}

  Law law_;  ///< the table is one over ln(rate)
};

/// Heat that stays where it was made, and how it softens: the yield stress is 1 - T*^m of what it is at the reference
/// temperature, T* = (T - reference) / (melting - reference), in 0 to 1 (Johnson & Cook 1983).
struct Heating {
  double capacity = 0.0;            ///< density times specific heat [stress / temperature], positive
  double melting = 0.0;             ///< temperature
  double reference = 0.0;           ///< temperature, less than melting
  double exponent = 1.0;            ///< m, positive
  double fraction = 0.9;            ///< of plastic work that heats (Taylor & Quinney 1934), 0 to 1
  std::optional<double> initial{};  ///< temperature; none: the reference

  /// Throws InputError for parameters out of range. Returns *this.
  const Heating& checked() const;
  /// By how much matter is warmer than at the start.
  Factor softening(double rise) const;
};

}  // namespace efree
