// SPDX-License-Identifier: GPL-3.0-or-later
/// Elasticity at finite strains: P = dW/dF. J = det F, C = F^T F, b = F F^T, E = (C - 1) / 2. The formulas, parameters
/// and sources of all materials stand side by side in docs/materials.md.
#pragma once

#include "efree/materials/material.hpp"
#include "efree/materials/moduli.hpp"

#include <vector>

namespace efree {

/// Isotropic and elastic at finite strains. All throw InputError for parameters out of range (of fields when they are
/// asked) and NumericalError where J <= 0, with the place.
class Hyperelastic : public Material {
 public:
  bool finite_strain() const final { return true; }
  bool elastic() const final { return true; }
};

/// W = lambda / 2 (tr E)^2 + mu E : E. For large rotations and small strains: it softens under compression, and
/// nothing stops it at J = 0.
class StVenantKirchhoff final : public Hyperelastic {
 public:
  explicit StVenantKirchhoff(const ElasticModuli& moduli) : moduli_(moduli.checked()) {}
  bool homogeneous() const override { return moduli_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  ElasticModuli moduli_;
};

/// W = mu / 2 (tr C - 3) - mu ln J + lambda / 2 (ln J)^2, sigma = mu / J (b - 1) + lambda ln(J) / J 1 (Simo & Pister
/// 1984; Bishop 2022).
class NeoHookean final : public Hyperelastic {
 public:
  explicit NeoHookean(const ElasticModuli& moduli) : moduli_(moduli.checked()) {}
  bool homogeneous() const override { return moduli_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  ElasticModuli moduli_;
};

/// W = c10 (I1 - 3) + c01 (I2 - 3) + U(J) of the invariants of C / J^(2/3) (Mooney 1940, Rivlin 1948), with
/// U = kappa / 4 (J^2 - 1 - 2 ln J) (Simo & Taylor 1982). The shear modulus is 2 (c10 + c01).
class MooneyRivlin final : public Hyperelastic {
 public:
  /// [stress]; c10 + c01 and kappa positive.
  MooneyRivlin(Parameter c10, Parameter c01, Parameter kappa);
  bool homogeneous() const override { return c10_.is_constant() && c01_.is_constant() && kappa_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  struct Constants {
    double c10, c01, kappa;
  };
  Constants at(const Vec<3>& X) const;

  Parameter c10_, c01_, kappa_;
};

/// W = mu / 2 (I1 - 3) + U(J): MooneyRivlin with c10 = mu / 2, c01 = 0. Changes of shape and of volume are apart.
class NeoHookeanSplit final : public Hyperelastic {
 public:
  explicit NeoHookeanSplit(const ElasticModuli& moduli) : moduli_(moduli.checked()) {}
  bool homogeneous() const override { return moduli_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  ElasticModuli moduli_;
};

/// One term of Ogden's material.
struct OgdenTerm {
  double mu = 0.0;     ///< [stress]
  double alpha = 0.0;  ///< not zero
};
/// W = sum of mu_p / alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3) + U(J) of the principal stretches over J^(1/3)
/// (Ogden 1972), U as in MooneyRivlin. The shear modulus is half the sum of mu_p alpha_p.
class Ogden final : public Hyperelastic {
 public:
  /// The shear modulus and kappa [stress] positive.
  Ogden(std::vector<OgdenTerm> terms, Parameter kappa);
  bool homogeneous() const override { return kappa_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  std::vector<OgdenTerm> terms_;
  Parameter kappa_;
};

/// W = mu dev(ln U) : dev(ln U) + kappa / 2 (ln J)^2, U the right stretch tensor (Hencky 1928).
class Hencky final : public Hyperelastic {
 public:
  explicit Hencky(const ElasticModuli& moduli) : moduli_(moduli.checked()) {}
  bool homogeneous() const override { return moduli_.is_constant(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  ElasticModuli moduli_;
};

}  // namespace efree
