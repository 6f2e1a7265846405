// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/assembly/internal/rigid_motions.hpp"

#include "efree/core/internal/spectrum.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace efree::internal {

template <int Dim> std::vector<std::string> motion_names(const Matrix& free, const Vec<Dim>& centre, double radius) {
  std::vector<std::string> names;
  const auto is_free = [&](const Motion<Dim>& motion) {
    return free.cols() > 0 && (motion - free * (free.transpose() * motion)).norm() < 1e-4 * motion.norm();
  };
  Matrix rest = free;  // the named translations are taken out
  const char* axes = "xyz";
  for (int i = 0; i < Dim; ++i)
    if (is_free(Motion<Dim>::Unit(i))) {
      names.push_back(fmt::format("translation along {}", axes[i]));
      rest.row(i).setZero();
    }
  if (Dim == 2 && free.cols() == rigid_motions<Dim>) return {names[0], names[1], "rotation"};
  if (Dim == 3)
    for (int i = 0; i < 3; ++i)
      if (is_free(Motion<Dim>::Unit(Dim + i))) {
        names.push_back(fmt::format("rotation about an axis along {}", axes[i]));
        rest.row(Dim + i).setZero();
      }
  const Index missing = free.cols() - static_cast<Index>(names.size());
  if (missing <= 0) return names;
  // What is left has no axis of its own: the dominant motions of the remainder.
  const Matrix of_rest = spectrum<Eigen::Dynamic>(rest * rest.transpose()).vectors;
  for (Index k = 0; k < missing; ++k) {
    const Motion<Dim> motion = of_rest.col(rigid_motions<Dim> - 1 - k);
    const Vec<Dim> shift = motion.template head<Dim>();
    const auto spin = motion.template tail<rigid_motions<Dim> - Dim>().eval();
    if (spin.norm() <= 1e-6) {
      names.push_back(fmt::format("translation along ({:.4g})", fmt::join(shift.normalized(), ", ")));
    } else if constexpr (Dim == 2) {
      const double rate = spin[0] / radius;
      names.push_back(
          fmt::format("rotation about ({:.4g}, {:.4g})", centre[0] - shift[1] / rate, centre[1] + shift[0] / rate));
    } else {
      const Vec<3> rate = spin / radius, at = centre + rate.cross(shift) / rate.squaredNorm();
      names.push_back(fmt::format("rotation about the axis through ({:.4g}) along ({:.4g})", fmt::join(at, ", "),
                                  fmt::join(rate.normalized(), ", ")));
    }
  }
  return names;
}

template std::vector<std::string> motion_names<2>(const Matrix&, const Vec<2>&, double);
template std::vector<std::string> motion_names<3>(const Matrix&, const Vec<3>&, double);

}  // namespace efree::internal
