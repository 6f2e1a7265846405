// SPDX-License-Identifier: GPL-3.0-or-later
/// Tearing: no principal stress above a strength that falls as matter opens.
#pragma once

#include "efree/materials/hardening.hpp"
#include "efree/materials/plasticity.hpp"

namespace efree {

/// What a material that bears so much tension is given by.
struct RankineParameters {
  ElasticModuli moduli;
  Parameter strength;             ///< tau_C, the largest principal stress there can be [stress], not negative
  Parameter softening = 0.0;      ///< alpha, what it loses by plastic strain [stress], from 0 up to the bulk modulus
  double damage_threshold = 1.0;  ///< share of the strength, over 0 up to 1, whose loss makes the material fail
  double failed_shear = 1.0;      ///< shear modulus after that, over the one before, over 0 up to 1; 1: it stays
  Strain strain = Strain::finite;
};

/// Largest principal (Kirchhoff) stress <= tau_C, associated flow, tau_C = max(strength - alpha a, 0) with da the sum
/// of the plastic stretches (Rankine 1857; Wang et al. 2020, who take the largest of them: the same as long as matter
/// opens in one direction only, while only the sum makes a tangent where two strains are equal, and a symmetric one).
/// Matter that has lost its strength has no stiffness against opening. Once it has failed its shear modulus is another,
/// and what that releases of the stored energy is dissipated; under pressure it carries as before. Where alpha is a
/// number, the energy that tearing dissipates falls with the size of what strains localise in: give `softening_modulus`
/// the length of that.
class Rankine final : public Plastic {
 public:
  /// Throws InputError for parameters out of range.
  explicit Rankine(RankineParameters parameters);
  bool homogeneous() const override;
  bool softens() const override { return !softening_.is_constant() || softening_.at(Vec<3>::Zero()) > 0.0; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  /// The constants of matter that has failed: the bulk modulus stays.
  ElasticConstants failed(const ElasticConstants& elastic) const;
  bool has_failed(const Hardening& strength, double a) const {
    return failed_shear_ < 1.0 && strength.at(a).stress <= (1.0 - damage_threshold_) * strength.at(0.0).stress;
  }
  void respond_near_identity(Index begin, int count, const Deformation& given, MaterialResponse& response) const;
  void respond_in_axes(Index p, const Deformation& given, MaterialResponse& response) const;

  Parameter strength_, softening_;
  double damage_threshold_, failed_shear_;
};

/// alpha = strength^2 length / (2 fracture_energy): tearing through a band of this width dissipates the fracture energy
/// [stress x length] per area (Bazant & Oh 1983). Throws InputError unless all are positive.
double softening_modulus(double strength, double fracture_energy, double length);

}  // namespace efree
