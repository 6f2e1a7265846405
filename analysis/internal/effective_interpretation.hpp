// SPDX-License-Identifier: GPL-3.0-or-later
/// What an effective tensor means: constants, symmetry, bounds.
#pragma once

#include "efree/analysis/effective.hpp"

#include <string>
#include <vector>

namespace efree::internal {

/// A part of the volume with its material.
struct EffectivePhase {
  std::string region;  ///< "void": nothing
  double fraction;
  SharedMaterial material{};
  double conductivity = 0.0;
};

/// Norm of a stiffness (that of the tensor, by Kelvin's notation) or of a conductivity.
double size_of(const Matrix& tensor, EffectiveProperty property);

/// Sets what follows from result.tensor: axes that void cuts, inverse, symmetry or principal values, with warnings.
/// Throws InputError if there is no stiffness (conductivity) along any axis.
void interpret(EffectiveProperty property, EffectiveResult& result);

/// Sets the bounds where all phases are isotropic and homogeneous; warns of nearly incompressible ones, which lock, and
/// of materials that are not linear, whose stiffness in the reference configuration is taken.
void find_bounds(EffectiveProperty property, Plane plane, const std::vector<EffectivePhase>& phases,
                 EffectiveResult& result);

}  // namespace efree::internal
