// SPDX-License-Identifier: GPL-3.0-or-later
/// When a material point breaks.
#pragma once

#include "efree/materials/piecewise_linear.hpp"

#include <array>
#include <optional>
#include <variant>
#include <vector>

namespace efree {

/// Equivalent plastic strain at failure of a metal, (D1 + D2 exp(D3 s)) (1 + D4 ln(rate / reference)) (1 + D5 T*) with
/// s the mean stress over von Mises' and T* the homologous temperature (Johnson & Cook 1985, eq. 9). The rate counts
/// from its reference on.
struct JohnsonCookFailure {
  std::array<double, 5> D{};
  double reference = 1.0;  ///< [1/time]
  double melting = 0.0;    ///< melting temperature over the reference temperature, their difference; 0: T* = 0
};

/// Equivalent plastic strain at failure of a metal.
class FailureStrain {
 public:
  /// Throws InputError unless the reference rate is positive and the rise to melting 0 or more.
  FailureStrain(const JohnsonCookFailure& law);
  /// By triaxiality (mean stress over von Mises', as in Bao & Wierzbicki 2004): linear between these points, constant
  /// below the first and beyond the last. Throws InputError unless triaxialities ascend and strains are positive.
  static FailureStrain table(std::vector<double> triaxiality, std::vector<double> strain);
  /// At a triaxiality, a rate of plastic strain [1/time] and a temperature over the reference temperature. The law of
  /// Johnson and Cook may be negative.
  double at(double triaxiality, double rate, double temperature_rise) const;

 private:
  using Law = std::variant<JohnsonCookFailure, PiecewiseLinear>;
  explicit FailureStrain(Law law) : law_(std::move(law)) {}

  Law law_;
};

/// When a material point breaks. Several criteria may be on; none is by default. Where one is, points whose
/// deformation would invert them break, too.
struct FractureCriteria {
  /// G_c of eigenerosion [stress length], 0: none. A point under tension breaks when the energy release rate
  /// G = C r sum(m W) / sum(m) over the points that were within the radius r of it gets there (Pandolfi & Ortiz 2012;
  /// Pandolfi, Li & Ortiz 2013), W the stored energy of those under tension. C is such that the field of a crack tip in
  /// plane strain (Irwin 1957) in the middle of the ball has its own G.
  double toughness = 0.0;
  double neighbourhood = 2.0;  ///< r over the spacing of nodes; 0: the point alone, a ball as large as it
  double stretch = 0.0;        ///< largest principal stretch at which a point breaks, more than 1; 0: none
  /// A point breaks when its plastic strain, over that at failure, has summed up to 1. For materials with an
  /// equivalent plastic strain in their history.
  std::optional<FailureStrain> strain{};
  /// Spall strength [stress], 0: none. A point breaks when its mean Cauchy stress, tension positive, is larger (Grady
  /// 1988).
  double spall = 0.0;
  bool on() const { return toughness > 0.0 || stretch > 0.0 || strain || spall > 0.0; }
};

}  // namespace efree
