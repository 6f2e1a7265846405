// SPDX-License-Identifier: GPL-3.0-or-later
/// What all plastic materials have in common.
#pragma once

#include "efree/materials/material.hpp"
#include "efree/materials/moduli.hpp"

namespace efree {

/// Isotropic elasticity up to a yield surface, backward Euler along principal axes beyond it. The same law at small
/// strains, of eps = sym(F - 1) = eps_e + eps_p and Cauchy stress, and at finite ones, of F = F_e F_p, Hencky's
/// logarithmic elastic strains ln V_e and Kirchhoff stress (Simo 1992; de Souza Neto, Peric & Owen 2008, section 14).
/// Remembers seven numbers (56 bytes) or more: eps_p, or C_p^-1 - 1 with C_p = F_p^T F_p, and the equivalent plastic
/// strain. `energy` is elastic, and that of back stresses; work against the yield stress, which heats or tears, is
/// `dissipated`. Throws NumericalError, with the place, where J <= 0 or no point of the yield surface is found.
class Plastic : public Material {
 public:
  Index history_size() const override { return 7; }
  bool homogeneous() const override { return moduli_.is_constant(); }
  bool finite_strain() const final { return strain_ == Strain::finite; }
  bool elastic() const final { return false; }
  /// "plastic_strain" at small strains, "inverse_plastic_metric" (C_p^-1 - 1) at finite ones, and
  /// "equivalent_plastic_strain".
  std::vector<HistoryPart> history_parts() const override;
  /// Whether stresses fall as matter flows: strains then localise, in bands as narrow as functions can make them.
  virtual bool softens() const = 0;

 protected:
  Plastic(const ElasticModuli& moduli, Strain strain) : moduli_(moduli.checked()), strain_(strain) {}

  ElasticModuli moduli_;
  Strain strain_;
};

}  // namespace efree
