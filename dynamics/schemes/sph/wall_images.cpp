// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/wall_images.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <cmath>

namespace efree::internal {

template <int Dim> std::vector<WallImage<Dim>> images_by(const std::vector<Wall<Dim>>& walls) {
  if (walls.size() > 32)
    throw InputError(fmt::format("smoothed particles: {} walls, expected at most 32", walls.size()));
  std::vector<WallImage<Dim>> images;
  for (std::size_t w = 0; w < walls.size(); ++w) {
    const Vec<Dim>& n = walls[w].normal;
    const Mat<Dim> mirror = Mat<Dim>::Identity() - 2.0 * n * n.transpose();
    const Vec<Dim> shift = 2.0 * walls[w].level * n;
    const Mat<Dim> turn = std::isfinite(walls[w].friction) ? mirror : Mat<Dim>(-Mat<Dim>::Identity());
    const std::size_t so_far = images.size();
    images.push_back({WallBits{1} << w, mirror, turn, shift});
    for (std::size_t k = 0; k < so_far; ++k) {
      const WallImage<Dim> other = images[k];
      if (!(other.Q * n - n).isZero(1e-9)) continue;  // not at right angles
      images.push_back({other.walls | WallBits{1} << w, mirror * other.Q, turn * other.A, shift + mirror * other.q});
    }
  }
  return images;
}

template std::vector<WallImage<2>> images_by(const std::vector<Wall<2>>&);
template std::vector<WallImage<3>> images_by(const std::vector<Wall<3>>&);

}  // namespace efree::internal
