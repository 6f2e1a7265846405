// SPDX-License-Identifier: GPL-3.0-or-later
/// Nearly incompressible materials that give way to pressure.
#pragma once

#include "efree/materials/material.hpp"

namespace efree::internal {

/// A material of finite strains that sees the power a of volumes alone: W(J^((a - 1) / 3) F). Its bulk modulus is a^2
/// of what it was where volumes keep, whatever its form, and it is as stable as it was.
class Softened final : public Material {
 public:
  /// share: a^2, > 0 and at most 1.
  Softened(SharedMaterial of, double share);
  Index history_size() const override { return of_->history_size(); }
  bool homogeneous() const override { return of_->homogeneous(); }
  bool finite_strain() const override { return true; }
  bool elastic() const override { return of_->elastic(); }
  bool symmetric() const override { return of_->symmetric(); }
  std::vector<HistoryPart> history_parts() const override { return of_->history_parts(); }
  void respond(const Deformation& deformation, MaterialResponse& response) const override;

 private:
  SharedMaterial of_;
  double power_;  ///< (a - 1) / 3
};

}  // namespace efree::internal
