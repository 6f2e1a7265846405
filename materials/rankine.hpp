// SPDX-License-Identifier: GPL-3.0-or-later
/// Tearing: no principal stress above a strength that falls as matter opens.
#pragma once

#include "efree/materials/plasticity.hpp"

namespace efree {

/// What a material that bears so much tension is given by.
struct RankineParameters {
  ElasticModuli moduli;
  Parameter strength;         ///< tau_C, the largest principal stress there can be [stress], not negative
  Parameter softening = 0.0;  ///< alpha, what it loses by plastic strain [stress], from 0 up to the bulk modulus
  Strain strain = Strain::finite;
};

/// Largest principal (Kirchhoff) stress <= tau_C, associated flow, tau_C = max(strength - alpha a, 0) with da the sum
/// of the plastic stretches (Rankine 1857; Wang et al. 2020, who take the largest of them: the same as long as matter
/// opens in one direction only, while only the sum makes a tangent where two strains are equal, and a symmetric one).
/// Matter that has lost its strength has no stiffness against opening. Where alpha is a number, the energy that tearing
/// dissipates falls with the size of what strains localise in: give `softening_modulus` the length of that.
class Rankine final : public Plastic {
 public:
  /// Throws InputError for parameters out of range.
  explicit Rankine(RankineParameters parameters);
  bool homogeneous() const override;
  bool softens() const override { return !softening_.is_constant() || softening_.at(Vec<3>::Zero()) > 0.0; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  void respond_near_identity(Index begin, int count, const Deformation& given, MaterialResponse& response) const;
  void respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const;

  Parameter strength_, softening_;
};

/// alpha = strength^2 length / (2 fracture_energy): tearing through a band of this width dissipates the fracture energy
/// [stress x length] per area (Bazant & Oh 1983). Throws InputError unless all are positive.
double softening_modulus(double strength, double fracture_energy, double length);

}  // namespace efree
