// SPDX-License-Identifier: GPL-3.0-or-later
/// Corners that make orthogonal linear functions.
#pragma once

#include "efree/core/types.hpp"

#include <cmath>

namespace efree::internal {

/// Corners xi_i of the regular simplex with |xi_i|^2 = Dim: their sum is 0 and xi_i . xi_j = -1, so that the functions
/// (1 + xi_i . y) / (Dim + 1) are orthogonal and have equal integrals under weights of mean 0 and covariance 1.
template <int Dim> Eigen::Matrix<double, Dim, Dim + 1> regular_simplex() {
  Eigen::Matrix<double, Dim, Dim + 1> corners;
  if constexpr (Dim == 2)
    corners << 0.0, -std::sqrt(1.5), std::sqrt(1.5), std::sqrt(2.0), -std::sqrt(0.5), -std::sqrt(0.5);
  else
    corners << 1, 1, -1, -1, 1, -1, 1, -1, 1, -1, -1, 1;
  return corners;
}

}  // namespace efree::internal
