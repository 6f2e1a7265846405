// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/schemes/sph/internal/lattice_waves.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace efree::internal {
namespace {

/// Calls visit(place) for all places of a cube of whole numbers from -n to n.
template <int Dim, class Visit> void for_each_place(int n, const Visit& visit) {
  Vec<Dim> place = Vec<Dim>::Constant(-n);
  while (true) {
    visit(place);
    int i = 0;
    while (i < Dim && place[i] == n) place[i++] = -n;
    if (i == Dim) return;
    ++place[i];
  }
}

/// A particle around one at the origin; lengths over the smoothing length.
template <int Dim> struct Neighbour {
  Vec<Dim> x;
  Vec<Dim> gradient;  ///< of the kernel, times the volume of a particle
};

template <int Dim> std::vector<Neighbour<Dim>> neighbours_on_lattice(const SphOptions& options) {
  const double spacing = 1.0 / options.smoothing;
  std::vector<Neighbour<Dim>> result;
  for_each_place<Dim>(static_cast<int>(std::ceil(kernel_support * options.smoothing)), [&](const Vec<Dim>& place) {
    const Vec<Dim> x = spacing * place;
    const double r = x.norm();
    if (r == 0.0 || r >= kernel_support) return;
    result.push_back(
        {x, Vec<Dim>(std::pow(spacing, Dim) * kernel_slope_over_distance(options.kernel, Dim, r, 1.0) * x)});
  });
  return result;
}

}  // namespace

template <int Dim> double damping_on_lattice(const SphOptions& options) {
  constexpr int waves = Dim == 2 ? 24 : 10;  // along half an axis
  const auto neighbours = neighbours_on_lattice<Dim>(options);
  double fastest = 0.0;
  for_each_place<Dim>(waves, [&](const Vec<Dim>& place) {
    if (place.minCoeff() < 0.0) return;
    const Vec<Dim> k = std::numbers::pi * options.smoothing / waves * place;
    Mat<Dim> damping = Mat<Dim>::Zero();
    for (const auto& [x, gradient] : neighbours)
      damping -= (1.0 - std::cos(k.dot(x))) / x.squaredNorm() * x * gradient.transpose();
    fastest = std::max(fastest, eigenvalues<Dim>(damping)[Dim - 1]);
  });
  return fastest;
}

template double damping_on_lattice<2>(const SphOptions&);
template double damping_on_lattice<3>(const SphOptions&);

}  // namespace efree::internal
