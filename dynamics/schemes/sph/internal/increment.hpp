// SPDX-License-Identifier: GPL-3.0-or-later
/// From the gradient of velocities in the middle of a step to what it does to deformation gradients.
#pragma once

#include "efree/core/types.hpp"

#include <Eigen/LU>

namespace efree::internal {

/// (I + A) (I - A)^-1, A half of the step times the gradient of velocities where particles are in the middle of it: F
/// after the step over that before. A rotation leaves lengths as they are, to rounding (Hughes & Winget 1980).
template <int Dim> Mat<Dim> increment(const Mat<Dim>& half) {
  return (Mat<Dim>::Identity() + half) * (Mat<Dim>::Identity() - half).inverse();
}

}  // namespace efree::internal
