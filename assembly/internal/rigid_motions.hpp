// SPDX-License-Identifier: GPL-3.0-or-later
/// Motions of a body as a whole.
#pragma once

#include "efree/core/types.hpp"

#include <Eigen/Geometry>
#include <string>
#include <vector>

namespace efree::internal {

/// Rigid motions of Dim dimensions: translations along the axes, then rotations about them (one in the plane).
template <int Dim> constexpr int rigid_motions = Dim*(Dim + 1) / 2;
template <int Dim> using Motion = Eigen::Matrix<double, rigid_motions<Dim>, 1>;

/// Displacement along d, at `arm` from the centre, of each rigid motion; rotations by 1/radius.
template <int Dim> Motion<Dim> motion_along(const Vec<Dim>& d, const Vec<Dim>& arm, double radius) {
  Motion<Dim> motion;
  motion.template head<Dim>() = d;
  if constexpr (Dim == 2)
    motion[2] = (arm.x() * d.y() - arm.y() * d.x()) / radius;
  else
    motion.template tail<3>() = arm.cross(d) / radius;
  return motion;
}

/// Names of motions that span the columns of `free` (orthonormal): translations along axes first, then the rest.
template <int Dim> std::vector<std::string> motion_names(const Matrix& free, const Vec<Dim>& centre, double radius);

}  // namespace efree::internal
