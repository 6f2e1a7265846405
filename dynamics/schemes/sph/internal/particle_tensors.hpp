// SPDX-License-Identifier: GPL-3.0-or-later
/// Tensors of a particle that sums over its neighbours take.
#pragma once

#include "efree/core/internal/spectrum.hpp"
#include "efree/dynamics/schemes/sph/sph.hpp"

#include <Eigen/LU>

namespace efree::internal {

/// What makes gradients exact where velocities are linear: the inverse of the moment sum V (x_j - x_i) (x) grad W,
/// which is 1 inside, about 1/2 across a surface and 0.23 in the corner of a cube. Particles with less get part of it.
template <int Dim> Mat<Dim> gradient_correction(const Mat<Dim>& moment) {
  constexpr double least = 0.2;
  const Mat<Dim> less = moment - least * Mat<Dim>::Identity();
  // Whether all eigenvalues are larger than that.
  bool regular = less(0, 0) > 0.0 && less.template topLeftCorner<2, 2>().determinant() > 0.0;
  if constexpr (Dim == 3) regular = regular && less.determinant() > 0.0;
  if (regular) return moment.inverse();
  const auto [values, axes] = spectrum<Dim>(moment);
  return axes * values.cwiseMax(least).cwiseInverse().asDiagonal() * axes.transpose();
}

/// A pressure on each principal axis.
template <int Dim> Mat<Dim> artificial_stress(const ArtificialStress& of, const Mat<Dim>& stress) {
  const auto [values, axes] = spectrum<Dim>(stress);
  const Vec<Dim> pressures = of.strength * values.cwiseMax(0.0) - of.compression * values.cwiseMin(0.0);
  return -axes * pressures.asDiagonal() * axes.transpose();
}

}  // namespace efree::internal
