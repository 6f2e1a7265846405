// SPDX-License-Identifier: GPL-3.0-or-later
/// What every material must keep: stress and tangent are derivatives, rigid motions change nothing that they should
/// not.
#pragma once

#include "efree/materials/material.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
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

/// One point at the origin with these deformation gradients.
inline Deformation deformed(const Material& material, const Mat<3>& F) {
  Deformation one = Deformation::none(Points<3>::Zero(3, 1), material.history_size());
  one.F.col(0) = F.reshaped();
  return one;
}

inline Mat<3> rotation(double angle, const Vec<3>& about) {
  return Eigen::AngleAxisd(angle, about.normalized()).toRotationMatrix();
}

/// Gradients whose principal stretches are equal, or nearly so, turned on both sides: all three, two of them, differing
/// by 1e-4 to 1e-14, and none.
inline Tensors nearly_equal_stretches(double stretch) {
  const Mat<3> left = rotation(0.8, {1.0, 2.0, -1.0}), right = rotation(-1.3, {0.5, 0.2, 1.0});
  std::vector<Mat<3>> all{Mat<3>::Identity()};
  for (const double apart : {0.0, 1e-14, 1e-10, 1e-7, 1e-4})
    for (const Vec<3>& stretches :
         {Vec<3>(1.0, 1.0 + apart, 1.0 - apart), Vec<3>(1.0, 1.0 + apart, 0.7), Vec<3>(1.0 + apart, 1.4, 1.0)})
      all.push_back(left * Mat<3>((stretch * stretches).asDiagonal()) * right);
  Tensors F(9, all.size());
  for (std::size_t p = 0; p < all.size(); ++p) F.col(p) = all[p].reshaped();
  return F;
}

/// Largest difference between P and the derivative of energy + dissipated, and between A and that of P, relative to the
/// largest entry of A of that point there or at rest, by central differences of fourth order; of these components. Of
/// steps h and h / 10 that which does better counts: the longer one may reach over the edge of what is elastic.
struct DerivativeErrors {
  double stress, tangent;
};
inline DerivativeErrors derivative_errors(const Material& material, const Deformation& at, double h,
                                          const std::vector<int>& components = {0, 1, 2, 3, 4, 5, 6, 7, 8}) {
  const MaterialResponse there = respond(material, at, true),
                         rest = respond(material, Deformation::none(at.X, material.history_size()), true);
  DerivativeErrors errors{0.0, 0.0};
  for (const int k : components) {
    Matrix off = Matrix::Constant(2, at.size(), 1e300);  // of stress, tangent
    for (const double step : {h, 0.1 * h}) {
      Vector potential = Vector::Zero(at.size());
      Tensors P = Tensors::Zero(9, at.size());
      for (const auto& [steps, weight] : {std::pair{-2, 1.0}, {-1, -8.0}, {1, 8.0}, {2, -1.0}}) {
        Deformation moved = at;
        moved.F.row(k).array() += steps * step;
        const MaterialResponse response = respond(material, moved, false);
        potential += weight / (12.0 * step) * (response.energy + response.dissipated);
        P += weight / (12.0 * step) * response.P;
      }
      for (Index p = 0; p < at.size(); ++p) {
        const double scale = std::max(there.A.col(p).cwiseAbs().maxCoeff(), rest.A.col(p).cwiseAbs().maxCoeff());
        const Vec<9> difference = P.col(p) - there.tangent_at(p).col(k);
        off(0, p) = std::min(off(0, p), std::abs(potential[p] - there.P(k, p)) / scale);
        off(1, p) = std::min(off(1, p), difference(components).cwiseAbs().maxCoeff() / scale);
      }
    }
    errors.stress = std::max(errors.stress, off.row(0).maxCoeff());
    errors.tangent = std::max(errors.tangent, off.row(1).maxCoeff());
  }
  return errors;
}

}  // namespace efree::testing
