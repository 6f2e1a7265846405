// SPDX-License-Identifier: GPL-3.0-or-later
/// One material at the strains of another kind: any at infinitesimal ones, linear ones at finite ones.
#pragma once

#include "efree/materials/material.hpp"

#include <optional>

namespace efree {

/// What a material is at infinitesimal strains: P = A (F - I), A its tangent where nothing has happened yet.
class Linearised final : public Material {
 public:
  explicit Linearised(SharedMaterial of);
  bool homogeneous() const override { return of_->homogeneous(); }
  bool linear() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  SharedMaterial of_;
  std::optional<MaterialResponse::Tangent> everywhere_;  ///< if it is homogeneous
};

/// A linear material at finite strains: S = C : E, E = (F^T F - I) / 2, C its stiffness (Saint-Venant and Kirchhoff,
/// whatever the anisotropy). For large rotations and small strains, as StVenantKirchhoff. Throws InputError for a
/// material that is not linear; responses throw NumericalError where J <= 0, with the place.
class GreenElastic final : public Material {
 public:
  explicit GreenElastic(SharedMaterial of);
  bool homogeneous() const override { return of_->homogeneous(); }
  bool finite_strain() const override { return true; }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  SharedMaterial of_;
  std::optional<MaterialResponse::Tangent> everywhere_;  ///< C, if it is homogeneous
};

}  // namespace efree
