// SPDX-License-Identifier: GPL-3.0-or-later
/// Elastic constants of isotropic materials.
#pragma once

#include "efree/materials/material.hpp"

#include <optional>

namespace efree {

/// The constants of an isotropic material that formulas are written in.
struct ElasticConstants {
  double lambda = 0.0;  ///< Lame's first [stress]
  double mu = 0.0;      ///< shear modulus [stress], positive
  double kappa = 0.0;   ///< bulk modulus lambda + 2 mu / 3 [stress], positive
};

/// Any two elastic constants of an isotropic material, numbers or fields of the place: `ElasticModuli{.E = 210e3, .nu =
/// 0.3}`. Poisson's ratio is in (-1, 0.5).
struct ElasticModuli {
  std::optional<Parameter> E = {};       ///< Young's modulus [stress]
  std::optional<Parameter> nu = {};      ///< Poisson's ratio
  std::optional<Parameter> mu = {};      ///< shear modulus [stress]
  std::optional<Parameter> kappa = {};   ///< bulk modulus [stress]
  std::optional<Parameter> lambda = {};  ///< Lame's first constant [stress]

  /// Throws InputError unless two are given and, as far as they are numbers, in range. Returns *this.
  const ElasticModuli& checked() const;
  bool is_constant() const;
  /// Throws InputError, which names the place, for values out of range.
  ElasticConstants at(const Vec<3>& X) const;
};

}  // namespace efree
