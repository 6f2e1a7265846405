// SPDX-License-Identifier: GPL-3.0-or-later
/// What every material must keep: stress and tangent are derivatives, rigid motions change nothing that they should
/// not.
#pragma once

#include "efree/materials/material.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <vector>

namespace efree::testing {

/// Points that are deformed at random, by gradients of this size.
inline Deformation random_deformation(const Material& material, Index points, double size) {
  Deformation deformation = Deformation::none(Points<3>::Random(3, points), material.history_size());
  deformation.F += size * Tensors::Random(9, points);
  return deformation;
}

/// Largest difference between P and the derivative of the energy, and between A and that of P, relative to the largest
/// entry of A, by central differences of step h; of these components of F and P.
struct DerivativeErrors {
  double stress, tangent;
};
inline DerivativeErrors derivative_errors(const Material& material, const Deformation& at, double h,
                                          const std::vector<int>& components = {0, 1, 2, 3, 4, 5, 6, 7, 8}) {
  const MaterialResponse there = respond(material, at, true);
  const double scale = there.A.cwiseAbs().maxCoeff();
  DerivativeErrors errors{0.0, 0.0};
  for (const int k : components) {
    Deformation ahead = at, behind = at;
    ahead.F.row(k).array() += h;
    behind.F.row(k).array() -= h;
    const MaterialResponse more = respond(material, ahead, false), less = respond(material, behind, false);
    for (Index p = 0; p < at.size(); ++p) {
      const double stress = (more.energy[p] - less.energy[p]) / (2.0 * h);
      errors.stress = std::max(errors.stress, std::abs(stress - there.P(k, p)) / scale);
      const Vec<9> off = (more.P.col(p) - less.P.col(p)) / (2.0 * h) - there.tangent_at(p).col(k);
      errors.tangent = std::max(errors.tangent, off(components).cwiseAbs().maxCoeff() / scale);
    }
  }
  return errors;
}

}  // namespace efree::testing
