// SPDX-License-Identifier: GPL-3.0-or-later
/// Radial kernels w(q), q = distance / support radius, w(0) = 1, w(q >= 1) = 0.
#pragma once

#include <algorithm>
#include <cmath>

namespace efree {

/// Weight as a function of the distance.
enum class Kernel {
  cubic_spline,    ///< C2 (Monaghan & Lattanzio 1985, scaled to w(0) = 1)
  quintic_spline,  ///< C4
  wendland_c2,     ///< (1 - q)^4 (4 q + 1) (Wendland 1995)
};

/// Value of the kernel at q >= 0.
inline double kernel_value(Kernel kernel, double q) {
  const auto plus = [](double x) { return std::max(0.0, x); };
  switch (kernel) {
    case Kernel::cubic_spline: {
      const double a = plus(1.0 - q), b = plus(0.5 - q);
      return 2.0 * a * a * a - 8.0 * b * b * b;
    }
    case Kernel::quintic_spline: {
      const double a = plus(3.0 - 3.0 * q), b = plus(2.0 - 3.0 * q), c = plus(1.0 - 3.0 * q);
      return (std::pow(a, 5) - 6.0 * std::pow(b, 5) + 15.0 * std::pow(c, 5)) / 66.0;
    }
    case Kernel::wendland_c2: {
      const double a = plus(1.0 - q);
      return a * a * a * a * (4.0 * q + 1.0);
    }
  }
  return 0.0;
}

}  // namespace efree
