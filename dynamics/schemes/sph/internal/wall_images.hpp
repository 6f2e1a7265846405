// SPDX-License-Identifier: GPL-3.0-or-later
/// Mirror images that walls have of particles: what is missing behind a wall in sums over neighbours (Libersky &
/// Petschek 1991).
#pragma once

#include "efree/dynamics/contact/rigid_body.hpp"

#include <cstdint>
#include <vector>

namespace efree::internal {

/// One bit for every wall.
using WallBits = std::uint32_t;

/// The image by a wall, or by two or three at right angles: of a particle with position x and velocity v it is at
/// Q x + q with velocity A v. Q and A are symmetric and their own inverses.
template <int Dim> struct WallImage {
  WallBits walls;
  Mat<Dim> Q, A;
  Vec<Dim> q;

  Vec<Dim> of(const Vec<Dim>& x) const { return Q * x + q; }
};

/// All images that walls have. Walls with infinite friction reverse velocities, the others their normal parts.
/// Throws InputError for more than 32 walls.
template <int Dim> std::vector<WallImage<Dim>> images_by(const std::vector<Wall<Dim>>& walls);

}  // namespace efree::internal
