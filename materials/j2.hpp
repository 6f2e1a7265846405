// SPDX-License-Identifier: GPL-3.0-or-later
/// Plasticity of metals.
#pragma once

#include "efree/materials/hardening.hpp"
#include "efree/materials/plasticity.hpp"
#include "efree/materials/rate_and_heat.hpp"

#include <optional>

namespace efree {

/// `J2({.moduli = {.E = 210e3, .nu = 0.3}, .yield = Hardening::linear(450.0, 129.0)})`. Johnson and Cook's (1983)
/// metals have Hardening::ludwik(A, B, n), RateFactor::johnson_cook(C, 1 / second) and Heating.
struct J2Parameters {
  ElasticModuli moduli;
  Hardening yield;         ///< yield stress in tension [stress]
  double kinematic = 0.0;  ///< modulus of the back stress, the slope it adds in tension [stress]; at small strains
  Strain strain = Strain::small;
  RateFactor rate{};                 ///< times the yield stress, by the rate of the equivalent plastic strain
  std::optional<Heating> heating{};  ///< none: temperature is of no importance
};

/// Von Mises: sqrt(3/2) |dev(tau) - beta| <= yield(a), associated flow, da = sqrt(2/3) |d eps_p|, with the back stress
/// beta = 2/3 kinematic eps_p (von Mises 1913, Prager 1956; radial return, Wilkins 1964, Simo & Taylor 1985). The
/// yield stress is that at the end of a step, with the mean rate of plastic strain in it and the temperature after it.
/// With heating "temperature_rise" is remembered, too, by which heat that came counts.
class J2 final : public Plastic {
 public:
  /// Throws InputError for parameters out of range.
  explicit J2(J2Parameters parameters);
  Index history_size() const override { return heating_ ? 8 : 7; }
  std::vector<HistoryPart> history_parts() const override;
  bool softens() const override { return yield_.falls() || heating_; }
  bool symmetric() const override { return rate_.constant() && !heating_; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  struct Flow;
  Flow flow_of(Index p, const Deformation& given, double e, const ElasticConstants& elastic) const;
  void respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const;
  void respond_near_identity(Index begin, int count, const std::optional<ElasticConstants>& alike,
                             const Deformation& given, MaterialResponse& response) const;

  Hardening yield_;
  double kinematic_;
  RateFactor rate_;
  std::optional<Heating> heating_;
};

}  // namespace efree
