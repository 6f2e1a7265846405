// SPDX-License-Identifier: GPL-3.0-or-later
/// Plasticity of metals.
#pragma once

#include "efree/materials/hardening.hpp"
#include "efree/materials/plasticity.hpp"

namespace efree {

/// `J2({.moduli = {.E = 210e3, .nu = 0.3}, .yield = Hardening::linear(450.0, 129.0)})`.
struct J2Parameters {
  ElasticModuli moduli;
  Hardening yield;         ///< yield stress in tension [stress]
  double kinematic = 0.0;  ///< modulus of the back stress, the slope it adds in tension [stress]; at small strains
  Strain strain = Strain::small;
};

/// Von Mises: sqrt(3/2) |dev(tau) - beta| <= yield(a), associated flow, da = sqrt(2/3) |d eps_p|, with the back stress
/// beta = 2/3 kinematic eps_p (von Mises 1913, Prager 1956; radial return, Wilkins 1964, Simo & Taylor 1985).
class J2 final : public Plastic {
 public:
  /// Throws InputError for parameters out of range.
  explicit J2(J2Parameters parameters);
  bool softens() const override { return yield_.falls(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  template <class Flow>
  bool respond_near_identity(Index p, const Deformation& given, MaterialResponse& response, const Flow& flow_of) const;

  Hardening yield_;
  double kinematic_;
};

}  // namespace efree
